"""The kinds of hands that move the handle, each declared once.

The command line, the window, sessions and exports read the table. How a kind comes to a force is a law of
`core.simulator.hand`; what steers it stands in `app/session_server/device_setup.py`.
"""

from typing import NamedTuple


class Input(NamedTuple):
    name: str  # on the command line, in sessions and recordings
    title: str
    does: str  # beside the choice
    begun_with: str  # a session that was begun with it was begun with ..
    meaning: str  # in exports
    simulated: bool = True  # it moves a simulated device: one can choose it in the window
    by_pointer: bool = False  # the pointer over the path is the hand
    person: bool = True  # a person moves it, who can be asked, blinded and given a break


MOUSE, HID, OPERATOR, SENSOR, PROGRAM = "mouse", "hid", "operator", "force sensor", "program"
INPUTS = {
    hand.name: hand
    for hand in (
        Input(
            MOUSE, "Mouse", "pulls the handle by a spring", "the simulated device and the mouse",
            "a person who pulled the simulated handle with the mouse", by_pointer=True,
        ),
        Input(
            HID, "Six-axis device", "its deflection is the force", "the simulated device and a six-axis device",
            "a person who pushed a six-axis device: its deflection, not a force sensor, moved the simulated handle",
        ),
        Input(
            OPERATOR, "Simulated operator", "moves the handle, no person is needed",
            "the simulated device and a simulated operator",
            "simulated operator: no person took part", person=False,
        ),
        Input(
            SENSOR, "Hand", "measured by the force sensor", "a device on the bench",
            "a hand at the device on the bench, its force measured by the device's sensor", simulated=False,
        ),
        Input(
            PROGRAM, "Program", "a function of Python", "the simulated device and a function of Python",
            "a function of Python gave the force on the simulated handle: no person took part", simulated=False,
            person=False,
        ),
    )
}  # fmt: skip


def is_person(hand: str) -> bool:
    """Whether a person moves the handle; an unknown kind of hand counts as one."""
    return hand not in INPUTS or INPUTS[hand].person


#: Those that one can choose.
CHOICES = tuple(hand.name for hand in INPUTS.values() if hand.simulated)
