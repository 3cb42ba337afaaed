"""Process 2: owns session and disk. No Qt, no ticks of its own."""
