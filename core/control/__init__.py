"""The controllers: what they decide from position, velocity and hand force. They touch no device."""
