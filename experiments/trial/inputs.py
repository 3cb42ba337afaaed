"""The kinds of hands that can move the handle, each declared once: recordings, exports and replays read the table."""

from typing import NamedTuple


class Input(NamedTuple):
    """One kind of hand."""

    name: str  # in sessions and recordings
    meaning: str
    has_target: bool  # a spring pulls the handle to a target, which is recorded: a replay can take it up again


MOUSE, OPERATOR, HID, SENSOR = "mouse", "operator", "hid", "force sensor"
INPUTS = {
    one.name: one
    for one in (
        Input(OPERATOR, "simulated operator: no person took part", True),
        Input(MOUSE, "a person who pulled the simulated handle with the mouse", True),
        Input(
            HID,
            "a person who pushed a six-axis device: its deflection, not a force sensor, moved the simulated handle",
            False,
        ),
        Input(SENSOR, "a hand at the device on the bench, its force measured by the device's sensor", False),
    )
}
