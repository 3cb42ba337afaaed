"""While the console is blind, no pixel of either window depends on what the controller does."""

import numpy as np
from fake_client import PLAN, movement, opened, pulse, running
from PySide6.QtGui import QImage
from screens import Screens, settle

from core import tick_log


def two_controllers() -> tuple[np.ndarray, np.ndarray]:
    """The same movement of the same hand through two controllers."""
    one = movement(PLAN[0].segment, "AEB", 0.6)
    other = one.copy()
    other[:, tick_log.CURRENT : tick_log.CURRENT + 4] = 0.0
    other[:, tick_log.TORQUE : tick_log.TORQUE + 4] *= -0.3
    other[:, tick_log.STUCK] = 0.0
    other[:, tick_log.ENERGY_BRAKES] += 0.2 * other[:, tick_log.T]
    return one, other


def pictures(screens: Screens, blind: bool) -> list[tuple[QImage, QImage]]:
    """Console with every layer on and participant's window after the movement through each controller."""
    found = []
    for rows in two_controllers():
        console = screens.hear(opened(), running(1, blind=blind), running(0, blind=blind), pulse())
        for button in screens.run.centre.workspace.buttons.values():
            button.setChecked(True)
        screens.participant.show()
        settle(console)  # curves are painted piece by piece from the first tick on, both times
        for begin in range(0, len(rows), 16):
            screens.tick(rows[begin : begin + 16])
        settle(console)
        found.append((console.grab().toImage(), screens.participant.view.grab().toImage()))
    return found


def test_blind_windows_look_the_same_whatever_the_controller_does(screens: Screens) -> None:
    (console, participant), (other_console, other_participant) = pictures(screens, blind=True)
    assert console == other_console and participant == other_participant


def test_with_the_key_the_console_shows_what_the_controller_does_and_the_participant_does_not_see_it(
    screens: Screens,
) -> None:
    (console, participant), (other_console, other_participant) = pictures(screens, blind=False)
    assert console != other_console and participant == other_participant
