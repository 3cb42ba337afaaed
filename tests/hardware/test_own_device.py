"""The template of docs/bench.md: with its bus filled in, it senses, stops and runs a trial."""

import math
import re
from pathlib import Path

import pytest
from real_bench import TIP

from core.device import load_device
from core.device_interface import DeviceError, RealDevice
from core.faults import cause
from core.files import InputError
from hardware.emulated_board.device import EmulatedDevice, EmulatedHand, HeldHand, hello_of
from hardware.own_driver import load_driver
from hardware.serial_device import device_at
from hardware.wire.messages import Fault

FILE = Path(__file__).resolve().parents[2] / "docs" / "examples" / "own_device.py"
DEVICE = load_device("four-brake")


class EmulatedBus:
    """A bus in simulated time: a device with a watchdog that is no board of ours."""

    def __init__(self, hand: EmulatedHand) -> None:
        self.device = EmulatedDevice(DEVICE, hello_of(DEVICE), hand, TIP, 1)
        self.ticks = self.heard = 0
        self.fault, self.currents = Fault.NONE, (0, 0, 0, 0)

    def tick(self) -> tuple:
        self.ticks += 1
        if self.ticks - self.heard >= 50 and any(self.currents):
            self.fault, self.currents = Fault.WATCHDOG, (0, 0, 0, 0)
        readings = self.device.sense(self.currents, ())
        self.device.advance(self.currents)
        counts = (readings.counts[0], readings.counts[2])
        return 1000 * self.ticks, counts, readings.force, readings.current_mA, self.fault

    def exchange(self, currents_mA: list[int]) -> tuple:
        self.heard = self.ticks
        self.currents = (0, 0, 0, 0) if self.fault else tuple(currents_mA)
        return self.tick()


def own_device(hand: EmulatedHand) -> tuple[RealDevice, EmulatedBus]:
    device = load_driver(f"driver:{FILE}")(DEVICE)
    device.bus = bus = EmulatedBus(hand)
    device.clock = lambda: 1e-3 * bus.ticks
    device.open()
    return device, bus


def test_the_template_senses_where_the_handle_is_and_takes_the_zero() -> None:
    device, bus = own_device(HeldHand(TIP))
    device.exchange((0.0,) * 4)
    device.home(TIP)
    assert not device.zeroed
    device.zero()
    sample = device.exchange((0.0,) * 4)
    assert device.zeroed and sample.homed and sample.closed and sample.tip == pytest.approx(TIP, abs=1e-4)
    assert math.hypot(*sample.hand_force) < 0.1 and len(device.samples()) > 500


def test_a_stop_and_a_host_that_falls_silent_take_the_currents_off_the_template() -> None:
    device, bus = own_device(HeldHand(TIP))
    wanted = (0.1, 0.2, 0.3, 5.0)
    device.exchange(wanted)
    most = [round(1e3 * current) for current in DEVICE.brakes.current_max]
    assert bus.currents == (100, 200, 300, most[3])
    device.stop()
    assert device.exchange(wanted).fault == cause("host-request") and not any(bus.currents)
    device.reset()
    device.exchange(wanted)
    assert any(bus.currents)
    for _ in range(50):
        bus.tick()
    assert bus.fault is Fault.WATCHDOG and not any(bus.currents)
    assert device.exchange(wanted).fault and not any(bus.currents)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "has no function new_device"),
        ("import nothing_of_that_name", "cannot be loaded"),
        ("import sys; sys.exit(3)", "cannot be loaded: SystemExit: 3"),
        (None, "there is no such file"),
        ("def new_device(device): raise ValueError('no such card')", "driver.py, line 1: ValueError: no such card"),
        ("def new_device(device): return None", "what new_device returns has no begin, close"),
    ],
)
def test_a_driver_that_is_none_is_refused(text: str | None, words: str, tmp_path: Path) -> None:
    file = tmp_path / "driver.py"
    if text is not None:
        file.write_text(text)
    with pytest.raises(InputError, match=words):
        device_at(DEVICE, f"driver:{file}")


BUS = """
class Card(Bus):
    ticks = 0
    def exchange(self, currents_mA):
        self.ticks += 1
        open(__file__ + ".asked", "w").write(str(self.ticks))
        {fails}
        return 1000 * self.ticks, (0, 0), (0,) * 6, tuple(currents_mA), 0
def new_device(device):
    return OwnDevice(device, Card())
"""


@pytest.mark.parametrize(
    ("right", "wrong", "words"),
    [
        ("{fails}", "if self.ticks == 20: 1 / 0", r"driver\.py, line \d+: ZeroDivisionError"),
        ("{fails}", "if self.ticks == 20: return 1, 2", "ValueError: not enough values"),
        ("return taken", "return None", "TypeError"),
        ("return taken", "return [1]", "samples.. must give a list of DeviceSample"),
    ],
)
def test_a_driver_that_fails_is_a_device_that_is_lost_for_good(right, wrong, words, tmp_path) -> None:
    """Nothing of it escapes into the loop; whatever is asked of it later, it is not asked again."""
    file = tmp_path / "driver.py"
    file.write_text((FILE.read_text() + BUS).replace(right, wrong, 1).replace("{fails}", "pass"))
    device = device_at(DEVICE, f"driver:{file}")
    device.open()
    for _ in range(30):
        sample = device.exchange((0.1, 0.0, 0.0, 0.0))
        taken = device.samples()
    assert re.search(words, device.problem) and sample is None and taken == []
    asked = (tmp_path / "driver.py.asked").read_text()
    device.exchange((0.1, 0.0, 0.0, 0.0))
    device.stop()
    assert device.report() == {} and (tmp_path / "driver.py.asked").read_text() == asked
    with pytest.raises(DeviceError, match=words):
        device.home(TIP)


def test_a_driver_that_cannot_be_opened_or_has_not_all_that_it_needs_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "driver.py"
    for right, wrong, words in (
        ("    def open(self):\n", "    def open(self):\n        raise OSError('none')\n", "line 32: OSError: none"),
        ("    def zero(self):", "    def nothing(self):", "returns has no zero"),
        ('force_channels = "my bus", "AB", 6', 'n = "my bus", "AB", 6', "once open it has no force_channels"),
    ):
        text = FILE.read_text()
        assert text.count(right) == 1
        file.write_text(text.replace(right, wrong))
        with pytest.raises(InputError, match=words):
            device_at(DEVICE, f"driver:{file}").open()
