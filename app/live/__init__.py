"""The live bench without Qt: conductor, control loop, the ring between them, and the window's end of it."""
