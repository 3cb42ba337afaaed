"""The ground of the window: parts, look, words, keys and curves; it imports nothing above it."""
