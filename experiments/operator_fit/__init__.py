"""A population file of simulated operators from the recorded trials of people."""
