"""A live trial on the bench whose hand force comes from a sensor on the network."""

import time
from pathlib import Path

import msgspec
import numpy as np
import pytest
from emulated import Emulated
from live import wait_until, window
from played_net_ft import HOST, PlayedSensor

from app.live import messages as m
from app.live.setup import Setup
from core import row
from experiments.recording import read_recording

pytest.importorskip("pynetft", reason="pynetft is not installed: ATI sensors cannot be read")


def test_a_sensor_on_the_network_is_zeroed_recorded_and_ends_the_trial_when_it_falls_silent(tmp_path: Path) -> None:
    sensor = PlayedSensor()
    sensor.counts = (1000, 0, 0, 0, 0, 0)
    emulated = Emulated(tmp_path, "--device", "four-brake", "--hand", "operator", "--seed", "3")
    try:
        link = f"{emulated.port} netft:{sensor.where}"
        setup = Setup(tmp_path / "data", devices=("four-brake",), link=link, sync=False)
        with window(setup) as opened:
            opened.until_stage(m.NO_SESSION)
            opened.bench.send(m.Open("01"))
            opened.until(lambda s: s.stage == m.RERIG and "Let go of the handle" in s.wait_for)
            emulated.order(away=True)
            time.sleep(0.3)
            opened.bench.send(m.Confirm())
            opened.until_stage(m.READY)
            emulated.order(away=False)
            segment = opened.snapshot.coming.segment
            emulated.order(path=msgspec.to_builtins(opened.opened.paths[segment]))
            sensor.counts = (6000, 0, 0, 0, 0, 0)
            opened.start()
            opened.until_tick(lambda ticks: (ticks[:, row.PHASE] == row.MOVE).any())
            sensor.plugged = False
            done = next(r for r in opened.until(lambda s: bool(s.rows)).rows)
            assert done.status == "stopped" and f"the force sensor at {HOST} sends nothing" in opened.snapshot.said
            wait_until(lambda: emulated.order()["currents_mA"] == [0] * 4)
            recording = read_recording(Path(opened.opened.folder) / done.recording)
            assert recording.whole and set(np.unique(recording.column("force_1_counts"))) <= {10_000.0, 60_000.0}
            assert recording.column("hand_fx_N").max() == pytest.approx(5.0, abs=1.0)
            assert recording.outcome["link"]["force_sensor"]["name"] == "Mini45"
            opened.until(lambda s: any(c.name == "Device" and c.state == m.BAD for c in s.checks))
            sensor.plugged = True
            opened.until(lambda s: any(c.name == "Device" and c.state == m.GOOD for c in s.checks))
    finally:
        emulated.end()
        sensor.close()
