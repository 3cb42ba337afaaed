"""Many worlds: which sets of assumptions produce the paper's findings."""
