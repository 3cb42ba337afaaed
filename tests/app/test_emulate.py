"""`phd emulate`: a board on a TCP port, a program of its own, and the host's link to it in real time. One on a
pseudo-terminal is in test_doctor, test_scripted_session and test_live_board."""

import contextlib
import math
import threading
import time
from collections.abc import Callable, Iterator

import pytest
from emulated import Emulated, when
from simulated_bench import nothing_looks_for_the_board
from waiting import LONG_S, wait_until

from app.emulated_operator import drawn_operator
from core.device import load_device
from core.device_interface import DeviceError
from core.files import InputError
from core.path import Segment, build_path
from core.tick_log import APPROACH, MOVE
from hardware.discovery import ask_board, scan_ports
from hardware.emulated_board.device import HeldHand
from hardware.emulated_board.emulator import Emulator, EmulatorSettings
from hardware.emulated_board.line_faults import read_fault
from hardware.emulated_board.plug import emulated_ports
from hardware.serial_device import SerialDevice

DEVICE = load_device("four-brake")
NO = (0.0,) * 4
SOME = (0.3,) * 4
START = (-0.10, 0.40)
LATE = "the board got no command for 50 ms"  # what a board rightly says where this machine held its host up
HELD_UP_S = 0.02  # longest that a host may be away before what the board says overflows


@pytest.fixture(scope="module")
def emulated(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Emulated]:
    running = Emulated(tmp_path_factory.mktemp("emulated"), "--seed", "4", "--socket")
    yield running
    assert running.end() == 0
    assert running.port not in emulated_ports()


@pytest.fixture
def link(emulated: Emulated) -> Iterator[SerialDevice]:
    emulated.order(clear=True)
    link = SerialDevice(DEVICE, emulated.port)
    retry_while_locked(link.open)
    forget(link)
    yield link
    link.close()
    nothing_looks_for_the_board()


def retry_while_locked(ask: Callable[[], object]) -> None:
    """Until the board's answer is there in time, which a machine with much else to do may keep from us."""

    def answered() -> bool:
        with contextlib.suppress(DeviceError, InputError):
            ask()
            return True
        return False

    wait_until(answered)


def forget(link: SerialDevice) -> None:
    """No fault is left on the board."""
    while run(link, 5)[-1].fault:
        retry_while_locked(link.reset)


def run(link: SerialDevice, n: int, currents=NO) -> list:
    """Exchange until n samples came."""
    samples: list = []
    wait_until(lambda: len(samples) == n or samples.extend(filter(None, [link.exchange(currents)])), pause=lambda: None)
    return samples


def until(link: SerialDevice, done: Callable[[], bool], currents=NO) -> None:
    """Exchange until something is so."""
    wait_until(done, pause=lambda: link.exchange(currents))


def test_samples_come_at_1_khz_with_nothing_lost_or_damaged(emulated: Emulated, link: SerialDevice) -> None:
    listened, end = False, time.perf_counter() + LONG_S
    while not listened and time.perf_counter() < end:
        came, held_up_s, health = run(link, 20), 0.0, link.health
        before = health.lost, health.frames.bad, health.repeated
        while came[-1].board_us - came[0].board_us < 300_000:
            asked = time.perf_counter()
            came += run(link, 1)
            held_up_s = max(held_up_s, time.perf_counter() - asked)
        assert (came[-1].sequence - came[0].sequence) * 1000 == came[-1].board_us - came[0].board_us
        assert all(sample.homed and sample.closed for sample in came)
        listened = held_up_s < HELD_UP_S
    if listened:
        assert before == (health.lost, health.frames.bad, health.repeated)
    truth = emulated.order()
    assert math.dist(came[-1].tip, truth["tip_m"]) < 1e-3
    assert truth["frames"]["bad_crc"] == 0


def test_an_unplugged_board_is_noticed_safe_and_back(emulated: Emulated, link: SerialDevice) -> None:
    run(link, 50, SOME)
    emulated.order(fault="unplug+0.2")
    until(link, lambda: bool(link.problem), SOME)
    until(link, lambda: not link.problem)
    assert run(link, 3)[-1].fault == LATE
    truth = emulated.order()
    assert when(truth, "currents zero") - when(truth, "unplug begins") <= 0.0515
    forget(link)
    until(link, lambda: run(link, 5, SOME)[-1].homed and emulated.order()["state"] == "ACTIVE" or forget(link), SOME)
    assert link.health.lost_links >= 1


def at_rest(emulated: Emulated) -> list[float]:
    """Where the handle is, m, once it has come to rest."""
    wait_until(lambda: max(map(abs, emulated.order()["velocity_m_s"])) <= 1e-3)
    return emulated.order()["tip_m"]


def test_the_board_follows_the_device_that_a_host_asks_for_and_the_handle_stays(emulated: Emulated) -> None:
    before = at_rest(emulated)
    for name in ("three-brake", "four-brake"):
        host = SerialDevice(load_device(name), emulated.port)
        retry_while_locked(host.open)
        sample, port = run(host, 3)[-1], emulated.port
        found = {one.port: one for one in scan_ports()}
        assert found[port].words == found[port].problem == "another program is using it"
        assert port not in {one.port for one in scan_ports(in_use=port)}
        host.close()
        (found,) = (one for one in scan_ports() if one.port == port)
        assert (found.words, found.problem) == (f"answers, {name}", "")
        assert sample.homed and math.dist(sample.tip, before) < 3e-3
        assert ask_board(emulated.port).device == name


def test_the_operator_waits_at_the_start_to_be_told_and_goes() -> None:
    path = build_path(Segment((-0.10, 0.40), (0.10, 0.40)), "path")
    operator = drawn_operator(path, 1)
    for order, phase in (({"wait": True}, APPROACH), ({"go": True}, MOVE)):
        operator.obey(order)
        for _ in range(1500):  # longer than it rests at the start by itself
            operator.tick(path.x0, path.y0)
        assert operator.phase == phase


def test_orders_that_make_no_sense_are_refused_and_change_nothing(emulated: Emulated) -> None:
    far, most = {"target": [0, 1e9]}, {"force": [10**400, 0]}
    for order in ({"fault": "nonsense"}, {"target": [1]}, far, most, {"force": "hard"}, {"dance": True}):
        assert "error" in emulated.order(**order)
    assert "error" in emulated.send("[" * 2000 + "]" * 2000)
    assert emulated.order()["state"] not in ("READY", "ACTIVE")


def test_the_start_of_a_fault_counts_from_when_a_host_first_asks_for_samples() -> None:
    settings = EmulatorSettings(tcp=0)
    emulator = Emulator([DEVICE], HeldHand(START), START, [read_fault("saturated-force@0.05")], settings)
    running = threading.Thread(target=emulator.run)
    running.start()
    link = SerialDevice(DEVICE, emulator.port)
    try:
        wait_until(lambda: emulator.ticks > 200)
        assert not any("saturated-force" in text for _, text in emulator.events)
        retry_while_locked(link.open)
        until(link, lambda: any("saturated-force begins" in text for _, text in emulator.events))
    finally:
        link.close()
        emulator.stop()
        running.join()
        emulator.close()
