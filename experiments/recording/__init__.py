"""One recording on disk: how ticks are written, checked and read."""
