"""One trial: the tick, its phases, the simulated operator. No files."""
