"""The Try page: the device in hand, with every number a slider, and the passes compared."""
