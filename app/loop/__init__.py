"""Process 1: the 1 kHz loop. Writes no files; no Qt."""
