"""The Haply 2diy, whose two motors act as brakes, only against the hand. No real one has been attached yet."""

HAPLY = "haply:"  # begins a link to one
