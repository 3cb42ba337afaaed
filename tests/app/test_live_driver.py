"""What is one's own through the real processes: a driver, `--link driver:FILE.py`, and a controller."""

from pathlib import Path

from live import live_window
from live_board import lets_go
from own_files import PROTOCOL, own_experiment

from app.ipc import messages as m
from app.ipc.messages import Setup
from experiments.store.journal import HOMED, ZEROED, read_journal

TEMPLATE = Path(__file__).resolve().parents[2] / "docs" / "examples" / "own_device.py"
#: begins at once where the handle is held, and goes on for half a second
TRIAL = "[trial]\nhold_s = 0.0\nstart_radius_m = 0.3\nend_radius_m = 0.001\ntime_out_s = 0.5\nend_s = 0.2\n"
#: in the place of the template's own: the simulated device, paced by the clock
BUS = """

import time

from hardware.emulated_board.device import EmulatedDevice, HeldHand, hello_of
from hardware.wire.messages import Fault


class EmulatedBus:
    def __init__(self, device):
        tip = (0.0, 0.4)
        self.device, self.ticks = EmulatedDevice(device, hello_of(device), HeldHand(tip), tip, 1), 0
        self.begun = time.perf_counter()

    def exchange(self, currents_mA):
        time.sleep(max(0.0, self.begun + 1e-3 * self.ticks - time.perf_counter()))
        self.ticks += 1
        readings = self.device.sense(tuple(currents_mA), ())
        self.device.advance(tuple(currents_mA))
        return 1000 * self.ticks, readings.counts[::2], readings.force, readings.current_mA, Fault.NONE


def new_device(device):
    return OwnDevice(device, EmulatedBus(device))
"""


def test_a_session_runs_on_a_driver_with_a_controller_of_ones_own(tmp_path: Path) -> None:
    driver, data = tmp_path / "my_rig.py", tmp_path / "data"
    driver.write_text(TEMPLATE.read_text() + BUS)
    text = PROTOCOL.replace("three-brake", "four-brake")
    protocol = own_experiment(tmp_path, text + TRIAL)
    with live_window(Setup(data, str(protocol), link=f"driver:{driver}", sync=False)) as window:
        window.until_stage(m.NO_SESSION)
        window.client.send(m.Open("01"))
        window.until(lambda s: s.card and "Hold the handle" in s.card.text)
        window.client.send(m.Confirm())
        window.until(lambda s: lets_go(s))
        window.client.send(m.Confirm())
        window.until_stage(m.READY)
        window.client.send(m.Start())
        (row,) = window.until(lambda s: s.rows).rows
        assert window.pulse.device.board == "OWN-1"
        recording = window.recording(row.run)
        assert recording.whole and (recording.text("decision") == "damped").sum() > 100
    events = [entry.event for entry in read_journal(data / "sub-01" / "ses-01").entries]
    assert [event for event in (HOMED, ZEROED) if event not in events] == []
