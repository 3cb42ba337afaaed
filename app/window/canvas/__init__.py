"""The drawings of the device and its forces, by QPainter, in metres; they know of no page."""
