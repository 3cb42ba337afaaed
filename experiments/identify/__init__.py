"""A brake file from measured current steps."""
