"""What long work calls while it goes on: `progress`, with the share (0 to 1) that is done."""

from collections.abc import Callable

Progress = Callable[[float], None]


def no_progress(share: float) -> None:
    """For work whose progress is not shown."""
