"""ATI Net F/T in place of a board's force channels, against a sensor that is played on loopback."""

import math
import os
from collections.abc import Iterator
from dataclasses import replace

import pytest
from played_net_ft import HOST, PlayedSensor
from real_bench import RealBench
from refusals import refusal
from simulated_bench import BenchWire
from waiting import wait_until

from core import tick_log
from core.device_file import ForceSensor
from core.device_interface import DeviceSample
from hardware.sensing.net_ft import SILENT_S, NetFT
from hardware.serial_device import SerialDevice

pytest.importorskip("pynetft", reason="pynetft is not installed: ATI sensors cannot be read")

NO_BOARD = f"serial:{os.devnull}"  # on every system something that can be opened
PATIENT_S = 60.0  # longer than any machine holds us up


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hardware.sensing.net_ft.START_S", PATIENT_S)


@pytest.fixture
def sensor() -> Iterator[PlayedSensor]:
    played = PlayedSensor()
    yield played
    played.close()


@pytest.fixture
def reader(sensor: PlayedSensor) -> Iterator[NetFT]:
    reader = NetFT(sensor.where)
    yield reader
    reader.close()


@pytest.fixture
def bench(sensor: PlayedSensor, monkeypatch: pytest.MonkeyPatch) -> Iterator[RealBench]:
    """A board in simulated time, the sensor in real time beside it, which a busy machine may hold up."""
    monkeypatch.setattr("hardware.sensing.net_ft.SILENT_S", PATIENT_S)
    bench = RealBench()
    bench.link.close()
    yield bench
    bench.link.close()


def connected(bench: RealBench, sensor: PlayedSensor, **mounting) -> SerialDevice:
    """The bench's own link, with the sensor."""
    device = bench.device
    if mounting:
        device = replace(device, sensing=device.sensing and type(device.sensing)(
            encoders=device.sensing.encoders, force=ForceSensor(**mounting)))  # fmt: skip
    link = SerialDevice(
        device, "bench", sensor.where, clock=bench.now, open_port=lambda name: BenchWire(bench.board, name)
    )
    link.open()
    link.home(bench.board.device.tip)
    bench.link = link
    return link


def sample_of(link: SerialDevice, counts: int) -> DeviceSample:
    """A sample, once the sensor says so many counts of force along x."""
    found: list[DeviceSample | None] = [None]

    def come() -> bool:
        found[0] = link.exchange((0.0,) * 4)
        return found[0] is not None and found[0].force_counts[0] == counts

    wait_until(come)
    assert found[0] is not None
    return found[0]


def test_the_load_is_counts_by_the_sensors_own_calibration(sensor: PlayedSensor, reader: NetFT) -> None:
    sensor.counts = (12_500, -3000, 700, 80, -90, 10)
    wait_until(lambda: reader.read() == (125_000, -30_000, 7000, 800, -900, 100))
    wait_until(lambda: reader.trouble() == "")
    assert reader.report()["name"] == "Mini45"


@pytest.mark.parametrize(
    ("unit", "newtons", "torque_unit", "newton_metres"),
    [("lbf", 4.4482216152605, "lbf-in", 0.1129848290276167), ("kgf", 9.80665, "kgf-cm", 0.0980665),
     ("kN", 1000.0, "N-mm", 1e-3)],
)  # fmt: skip
def test_other_units_become_newtons(unit: str, newtons: float, torque_unit: str, newton_metres: float) -> None:
    sensor = PlayedSensor(unit, torque_unit)
    sensor.counts = (2000, 0, 0, 50_000, 0, 0)
    reader = NetFT(sensor.where)
    try:
        wait_until(lambda: reader.read()[0] != 0)
        assert reader.read() == (round(2e4 * newtons), 0, 0, round(5e5 * newton_metres), 0, 0)
    finally:
        reader.close()
        sensor.close()


@pytest.mark.parametrize(("on", "turned"), [("handle", 0.5), ("ED", None)])
def test_the_sensors_force_stands_in_for_the_boards_turned_as_it_is_mounted(bench, sensor, on, turned) -> None:
    link = connected(bench, sensor, on=on, rotation_rad=0.5)
    sensor.counts = (10_000, 0, 0, 0, 0, 0)
    assert link.sensing is not None and link.force_channels == 6
    sample = sample_of(link, 100_000)
    turned = sample.theta[0] + sample.theta[1] + 0.5 if turned is None else turned
    assert sample.hand_force == pytest.approx((10 * math.cos(turned), 10 * math.sin(turned)))


def test_a_sensor_that_falls_silent_ends_the_trial_with_brakes_off_and_serves_again_when_it_is_back(
    bench: RealBench, sensor: PlayedSensor, monkeypatch: pytest.MonkeyPatch
) -> None:
    link, trial = connected(bench, sensor), bench.trial(2)
    while not any(trial.currents):
        bench.run(trial, lambda trial: trial.finished or trial.phase == "move" and any(trial.currents))
        if trial.finished:  # the machine held up who plays the sensor: rightly it counted as silent
            assert "sends nothing" in trial.outcome()["reason"]
            wait_until(lambda: link.exchange((0.0,) * 4) is not None)
            trial = bench.trial(2)
    sensor.plugged = False
    monkeypatch.setattr("hardware.sensing.net_ft.SILENT_S", 0.5)
    rows = bench.run(trial)
    outcome = trial.outcome()
    assert outcome["status"] == "aborted" and f"the force sensor at {HOST} sends nothing" in outcome["reason"]
    assert outcome["link"]["force_sensor"]["records"] > 0
    assert not any(bench.board.board.currents) and not any(trial.currents)
    assert not len(rows) or rows[-1, tick_log.PHASE] in (tick_log.MOVE, tick_log.END)
    assert link.exchange((0.5,) * 4) is None and "sends nothing" in link.problem
    assert not any(bench.board.board.currents), "currents need a hand that is felt"
    sensor.plugged = True
    wait_until(lambda: link.exchange((0.0,) * 4) is not None)
    assert link.problem == ""


def test_records_that_the_sensor_calls_wrong_are_no_force(sensor: PlayedSensor, reader: NetFT) -> None:
    sensor.counts = (1000, 0, 0, 0, 0, 0)
    wait_until(lambda: reader.read()[0] == 10_000)
    sensor.status = 0x80020000  # a gauge is saturated or broken
    sensor.counts = (60_000, 0, 0, 0, 0, 0)
    wait_until(lambda: reader.report()["doubtful"] > 0)
    wait_until(lambda: reader.trouble() != "")
    assert reader.read()[0] == 10_000


def test_lost_records_are_counted(sensor: PlayedSensor, reader: NetFT) -> None:
    sensor.skip = 7
    wait_until(lambda: reader.report()["lost"] == 7)


@pytest.mark.parametrize("dead", [True, False], ids=["nobody answers", "no records come"])
def test_a_sensor_that_is_silent_from_the_start_is_one_sentence_before_any_window(
    sensor: PlayedSensor, dead: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, tmp_path
) -> None:
    monkeypatch.setattr("hardware.sensing.net_ft.START_S", 0.3)
    sensor.plugged = False
    where = f"{HOST}:{sensor.rdt_port}:1" if dead else sensor.where
    told = refusal(capsys, "run", "--link", NO_BOARD, "--force", f"netft:{where}", "--data-dir", tmp_path)
    assert told.startswith(f"phd: the force sensor at {where} sends no records: ")


def test_closing_stops_the_stream(sensor: PlayedSensor) -> None:
    reader = NetFT(sensor.where)
    reader.close()
    wait_until(lambda: sensor.commands[-1] == 0)
    assert sensor.commands[0] in (0, 2) and SILENT_S <= 0.05
