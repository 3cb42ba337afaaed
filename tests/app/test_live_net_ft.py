"""A live trial on the bench whose hand force comes from a sensor on the network, and whose board is at a TCP port."""

from pathlib import Path

import numpy as np
import pytest
from live import wait_until
from live_board import board_session
from played_net_ft import HOST, PlayedSensor

from app.ipc import messages as m
from experiments.recording.reader import read_recording

pytest.importorskip("pynetft", reason="pynetft is not installed: ATI sensors cannot be read")


def test_a_sensor_on_the_network_is_zeroed_recorded_and_ends_the_trial_when_it_falls_silent(tmp_path: Path) -> None:
    sensor = PlayedSensor()
    try:
        sensor.counts = (1000, 0, 0, 0, 0, 0)
        with board_session(tmp_path, f"{{port}} netft:{sensor.where}", "--socket") as session:
            window, emulated = session.window, session.emulated
            session.open()
            session.make_ready()
            sensor.counts = (6000, 0, 0, 0, 0, 0)

            def unplug() -> None:
                sensor.plugged = False

            done = session.cut_short(unplug, says=f"the force sensor at {HOST} sends nothing")
            assert done.status == "stopped"
            wait_until(lambda: emulated.order()["currents_mA"] == [0] * 4)
            recording = read_recording(session.folder / done.recording)
            assert recording.whole and set(np.unique(recording.column("force_1_counts"))) <= {10_000.0, 60_000.0}
            assert recording.column("hand_fx_N").max() == pytest.approx(5.0, abs=1.0)
            assert recording.outcome["link"]["force_sensor"]["name"] == "Mini45"
            window.until(lambda s: session.device().state == m.BAD)
            sensor.plugged = True
            window.until(lambda s: session.device().state == m.GOOD or s.brakes_off)
            session.make_ready()

            assert emulated.port.startswith("socket://")
            emulated.order(fault="unplug+0.5")
            window.until(lambda s: session.device().text == "not connected")
            window.until(lambda s: session.device().state == m.GOOD or s.brakes_off)
            session.make_ready()
    finally:
        sensor.close()
