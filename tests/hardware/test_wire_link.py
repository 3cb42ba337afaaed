"""The host's side of the wire, and its zero, against a board in simulated time: no port, no clock, any fault."""

import math
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest
from simulated_bench import NO, TIP, Bench, homed_link, reached, run

from core.device_interface import DeviceError
from core.files import InputError
from hardware.emulated_board.board import Board
from hardware.sensing.samples import ZERO_SAMPLES
from hardware.serial_device import SerialDevice
from hardware.wire.frames import FrameDecoder, encode_frame
from hardware.wire.messages import Limits, State, pack, unpack


@pytest.fixture
def bench() -> Bench:
    return Bench()


@pytest.fixture
def link(bench: Bench) -> Iterator[SerialDevice]:
    yield from homed_link(bench)


def until(link: SerialDevice, done, patience_s: float = 60.0) -> None:
    """Exchange until something is so."""
    end = time.perf_counter() + patience_s
    while not done():
        assert time.perf_counter() < end, link.problem
        link.exchange(NO)


def test_samples_say_where_the_tip_is_and_what_the_hand_does(bench: Bench, link: SerialDevice) -> None:
    bench.hand.obey({"target": [0.05, 0.38], "force": [2.0, 0.0]})
    for _ in range(200):
        (sample,) = run(link, 1)
    assert sample.closed and sample.homed and not sample.fault
    assert math.dist(sample.tip, bench.device.tip) < 1e-3
    (*_, sample) = run(link, 2000)
    assert math.dist(sample.tip, bench.device.tip) < 5e-5
    force = np.mean([s.hand_force for s in run(link, 300)], axis=0)
    assert np.allclose(force, bench.device.hand_force, atol=0.05)


def test_every_sample_is_taken_once_and_every_command_is_echoed(bench: Bench, link: SerialDevice) -> None:
    taken = run(link, 500)
    assert [b.sequence - a.sequence for a, b in zip(taken, taken[1:], strict=False)] == [1] * 499
    assert [b.echo - a.echo for a, b in zip(taken, taken[1:], strict=False)] == [1] * 499
    assert link.health.lost == link.health.repeated == link.health.frames.bad == 0


def test_the_delay_from_sample_to_current_is_measured(bench: Bench, link: SerialDevice) -> None:
    run(link, 50)
    assert link.report()["delay_ticks"] == 1, "as by USB"
    bench.fault("delay=0.001")
    run(link, 50)
    assert link.report()["delay_ticks"] == 3, "a millisecond more each way"


@pytest.mark.parametrize(
    ("capability", "says"),
    [
        ({"device": b""}, "does not say which device it is wired to: its firmware must name 'four-brake'"),
        ({"device": b"three-brake"}, "wired to the device 'three-brake', not to 'four-brake'"),
        ({"counts_per_rev": (8192, 0, 8192, 0)}, "has encoders A = 8192, B = 8192"),
        ({"encoders": 0b1010, "counts_per_rev": (0, 96000, 0, 96000)}, "has encoders E = 96000, C = 96000"),
        ({"brakes": 0b0111}, "drives no brake at C"),
        ({"current_max_mA": (1000, 1000, 300, 1000)}, "gives the brake at B at most 0.3 A, .* four-brake says 1 A"),
        ({"force_channels": 0}, "the board sends 0 channels"),
    ],
)
def test_another_board_than_the_device_file_says_is_refused(capability: dict, says: str) -> None:
    bench = Bench(**capability)
    with pytest.raises(InputError, match=says):
        reached(bench)


def test_a_port_where_nothing_answers_is_one_sentence() -> None:
    bench = Bench()
    bench.fault("drop=1")
    with pytest.raises(InputError, match="bench: no board answers there"):
        reached(bench)


@pytest.mark.parametrize("kind", ["drop=0.1", "corrupt=0.1", "duplicate=0.1"])
def test_a_bad_wire_is_counted_and_survived(bench: Bench, link: SerialDevice, kind: str) -> None:
    run(link, 20, (0.2,) * 4)
    bench.fault(kind)
    came = run(link, 1000, (0.2,) * 4)
    health, counts = link.health, bench.to_host.counts
    assert bench.board.state == State.ACTIVE and link.problem == ""
    assert len(came) > 500
    if kind.startswith("drop"):
        assert health.lost == pytest.approx(counts["drop"], abs=3) and counts["drop"] > 50
    if kind.startswith("corrupt"):  # a flip in the zero byte takes the next frame with it
        assert health.lost == pytest.approx(counts["corrupt"], rel=0.1)
        assert health.frames.bad > 50 and bench.board.decoder.counts.bad > 50
    if kind.startswith("duplicate"):
        assert health.repeated == pytest.approx(counts["duplicate"], abs=3) and health.lost == 0
        assert bench.board.counts.old > 50
    sequences = [sample.sequence for sample in came]
    assert sequences == sorted(set(sequences))
    assert all(math.dist(sample.tip, TIP) < 0.01 for sample in came)


def test_a_board_that_nobody_talked_to_is_taken_up_again(bench: Bench, link: SerialDevice) -> None:
    for _ in range(1200):
        bench.tick()
    assert bench.board.state == State.IDLE
    until(link, lambda: run(link, 1) != [])
    assert bench.board.state == State.READY


class GenerousBoard(Board):
    """Sets limits that nobody has asked for."""

    def receive(self, data: bytes, now_us: int) -> bytes:
        payloads = FrameDecoder().feed(super().receive(data, now_us))
        said = [unpack(payload) for payload in payloads]
        more = [pack(one._replace(current_mA=(3000,) * 4)) if isinstance(one, Limits) else None for one in said]
        return b"".join(encode_frame(new or old) for new, old in zip(more, payloads, strict=True))


def test_limits_that_were_not_asked_for_are_no_connection() -> None:
    with pytest.raises(InputError, match="other current limits"):
        reached(Bench(kind=GenerousBoard))


def test_zero_takes_what_is_read_with_no_hand_and_no_current(bench: Bench, link: SerialDevice) -> None:
    bench.hand.hand.grips["spring"][0] = 0
    sense = bench.device.sense

    def offset(currents, faults):
        readings = sense(currents, faults)
        force = tuple(f + 300 for f in readings.force)
        return readings._replace(force=force, current_mA=tuple(c + 12 for c in readings.current_mA))

    bench.device.sense = offset
    assert abs(run(link, 5)[-1].hand_force[0] - 0.3) < 0.1
    record = link.zero()
    assert record.samples == ZERO_SAMPLES
    assert np.allclose(record.force_counts, 300.0, atol=3.0) and max(record.force_spread) < 40.0
    assert np.allclose(record.current, 0.012, atol=5e-4)
    after = run(link, 200)
    assert np.allclose(np.mean([s.hand_force for s in after], axis=0), 0.0, atol=0.01)
    assert np.allclose(np.mean([s.current for s in after], axis=0), 0.0, atol=5e-4)


def test_zero_refuses_a_handle_that_moves(bench: Bench, link: SerialDevice) -> None:
    bench.hand.obey({"target": [0.08, 0.35]})
    with pytest.raises(DeviceError, match="the handle moved"):
        link.zero()


def once_back(bench: Bench, link: SerialDevice) -> None:
    run(link, 300)
    while link.problem:
        link.exchange(NO)
        with bench.lock:
            bench.backlog += bench.tick()


@pytest.mark.parametrize(
    ("fault", "keeps"), [("unplug@0+0.3", True), ("brown-out@0+0.3", False), ("uncounted-start@0+0.3", False)]
)
def test_a_zero_holds_for_the_board_it_was_taken_on_until_it_starts_again(bench, link, fault, keeps) -> None:
    assert not link.zeroed and link.report()["zero"] is None
    record = link.zero()
    assert link.zeroed and link.report()["zero"] == record._asdict()
    bench.fault(fault)
    once_back(bench, link)
    assert link.zeroed == keeps
    assert link.sensing.force.zero == pytest.approx(record.force_counts if keeps else np.zeros(6))


def test_a_power_up_that_the_board_does_not_count_is_a_fault_until_a_person_resets_it() -> None:
    bench = Bench()
    link = reached(bench)
    link.home(TIP)
    link.zero()
    run(link, 400, (0.5,) * 4)
    starts = link.sensing.hello.starts
    bench.fault("uncounted-start@0.001+0.01")
    while not link.problem:
        link.exchange((0.5,) * 4)
    until(link, lambda: not link.problem)
    assert bench.board.starts == starts and not link.zeroed and not link.sensing.force.zero.any()
    for _ in range(2):  # a link that is lost again makes nothing well
        said = run(link, 20)
        (fault,) = {s.fault for s in said}
        assert fault == f"the board was powered up again, though its number of starts is still {starts}"
        assert said[0].fault.code == "started-again" and not any(s.homed for s in said)
        bench.fault("unplug@0+0.1")
        once_back(bench, link)
    link.reset()
    assert not any(s.fault for s in run(link, 20))
    link.home(TIP)
    link.zero()
    bench.fault("unplug@0+0.3")
    once_back(bench, link)
    assert link.zeroed and not any(s.fault for s in run(link, 20)), "this time it went on"
    link.close()


def test_a_board_that_was_away_for_a_moment_while_its_zero_was_taken_has_none(bench, link, monkeypatch) -> None:
    exchange, calls = link.exchange, []

    def away_at_the_hundredth(currents):
        calls.append(currents)
        if len(calls) == 100:
            bench.plugged = False
            assert exchange(currents) is None
            bench.plugged = True
            until_reached()
        return exchange(currents)

    def until_reached() -> None:
        for thread in threading.enumerate():
            if thread.name == "reconnect the board":
                thread.join()

    monkeypatch.setattr(link, "exchange", away_at_the_hundredth)
    with pytest.raises(DeviceError, match="the board was away meanwhile"):
        link.zero()
    assert len(calls) < 2 * ZERO_SAMPLES and not link.zeroed


def test_a_zero_that_could_not_be_taken_leaves_the_one_before(bench: Bench, link: SerialDevice) -> None:
    sense = bench.device.sense

    def offset(currents, faults):
        readings = sense(currents, faults)
        return readings._replace(current_mA=tuple(c + 12 for c in readings.current_mA))

    bench.device.sense = offset
    before = link.zero()
    bench.fault("drop=1@0.1+5")
    with pytest.raises(DeviceError, match="zero: "):
        link.zero()
    bench.faults.clear()
    once_back(bench, link)
    assert link.zeroed and link.sensing.zero == before
    again = link.zero()
    assert np.allclose(again.current, before.current, atol=5e-4) and np.allclose(again.current, 0.012, atol=5e-4)
    assert np.allclose(np.mean([s.current for s in run(link, 200)], axis=0), 0.0, atol=5e-4)


def test_without_homing_nobody_can_tell_whether_the_handle_is_still(bench: Bench) -> None:
    bench.device.sensors.power_up()
    link = reached(bench)
    with pytest.raises(DeviceError, match="home the encoders first"):
        link.zero()
    assert not link.zeroed
    link.close()
