"""The zero of force sensor and amplifiers: what it is taken from, and how long it holds."""

import threading
from collections.abc import Iterator

import numpy as np
import pytest
from simulated_bench import NO, Bench, homed_link, reached, run

from core.device_interface import DeviceError
from hardware.sensing.samples import ZERO_SAMPLES
from hardware.serial_device import SerialDevice


@pytest.fixture
def bench() -> Bench:
    return Bench()


@pytest.fixture
def link(bench: Bench) -> Iterator[SerialDevice]:
    yield from homed_link(bench)


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


@pytest.mark.parametrize(("fault", "keeps"), [("unplug@0+0.3", True), ("brown-out@0+0.3", False)])
def test_a_zero_holds_for_the_board_it_was_taken_on_until_it_starts_again(
    bench: Bench, link: SerialDevice, fault: str, keeps: bool
) -> None:
    assert not link.zeroed and link.report()["zero"] is None
    record = link.zero()
    assert link.zeroed and link.report()["zero"] == record._asdict()
    bench.fault(fault)
    once_back(bench, link)
    assert link.zeroed == keeps
    assert link.sensing.force.zero == pytest.approx(record.force_counts if keeps else np.zeros(6))


def test_a_board_that_was_away_while_its_zero_was_taken_has_none(bench: Bench, link: SerialDevice) -> None:
    bench.fault("unplug@0.1+0.1")
    with pytest.raises(DeviceError, match="zero: "):
        link.zero()
    once_back(bench, link)
    assert not link.zeroed and not link.sensing.force.zero.any()


def test_a_board_that_was_away_for_a_moment_while_its_zero_was_taken_has_none(
    bench: Bench, link: SerialDevice, monkeypatch: pytest.MonkeyPatch
) -> None:
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
            if thread.name == "bring the board back":
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
