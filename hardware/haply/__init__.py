"""The Haply 2diy, whose two motors stand for brakes: only ever against the hand. Never attached to a real one."""

HAPLY = "haply:"  # begins a link to one
