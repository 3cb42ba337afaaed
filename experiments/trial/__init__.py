"""One trial: the tick, its phases, the simulated operator. Reads population files, writes none."""
