"""Process 3: Qt. Paints rows and sends commands. No physics, no control law."""
