"""Whose hand moves the handle."""

from app.ipc import messages as m
from app.ipc.messages import MOUSE


def hand_is_mouse(opened: m.Opened | None) -> bool:
    """Whether the pointer is the hand (until it is known what is, yes: the pointer does nothing then)."""
    return opened is None or opened.hand == MOUSE
