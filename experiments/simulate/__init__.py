"""One scene without an operator: files in, motion out."""
