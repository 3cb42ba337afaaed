"""Whose hand moves the handle."""

from app.live import messages as m


def hand_is_mouse(snapshot: m.Snapshot) -> bool:
    """Whether the pointer is the hand (until it is known what is, yes: the pointer does nothing then)."""
    return next((check.text.startswith("mouse") for check in snapshot.checks if check.name == "Hand"), True)
