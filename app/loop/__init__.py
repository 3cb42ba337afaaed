"""Process 1: the 1 kHz loop. No files, no Qt."""
