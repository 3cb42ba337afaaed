"""Live sessions on the bench over the emulated board, with what a bad day does to them, and a sensor on the network."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from emulated import to_zero_s
from live import kill
from live_board import BoardSession, board_session, lets_go
from played_net_ft import HOST, PlayedSensor
from processes import gone
from waiting import wait_until

from app.ipc import messages as m
from experiments.store.journal import ZEROED, read_events
from experiments.store.recording import read_recording

pytest.importorskip("pynetft", reason="pynetft is not installed: ATI sensors cannot be read")


@pytest.fixture
def sensor() -> Iterator[PlayedSensor]:
    sensor = PlayedSensor()
    sensor.counts = (1000, 0, 0, 0, 0, 0)
    yield sensor
    sensor.close()


@pytest.fixture
def session(tmp_path: Path, sensor: PlayedSensor) -> Iterator[BoardSession]:
    with board_session(tmp_path, f"{{port}} netft:{sensor.where}") as session:
        yield session


def zeros(session: BoardSession) -> list[dict]:
    """What the journal says of them."""
    return [entry.about for entry in read_events(session.folder) if entry.event is ZEROED]


def test_a_session_on_the_bench_through_faults_to_its_end(session: BoardSession, sensor: PlayedSensor) -> None:
    window, emulated = session.window, session.emulated
    window.until_stage(m.NO_SESSION)
    session.open()
    assert window.opened.real_device and window.opened.hand == "force sensor"
    session.make_ready()
    (zero,) = zeros(session)
    assert zero["samples"] == 500 and len(zero["force_counts"]) == 6
    assert session.device() == m.Check("Device", m.GOOD, "four-brake, board EMULATED-3")
    sensor.counts = (6000, 0, 0, 0, 0, 0)

    # the sensor on the network falls silent
    def unplug_sensor() -> None:
        sensor.plugged = False

    stopped = session.cut_short(unplug_sensor, says=f"the force sensor at {HOST} sends nothing")
    assert stopped.status == "stopped"
    wait_until(lambda: emulated.order()["currents_mA"] == [0] * 4)
    recording = read_recording(session.folder / stopped.recording)
    assert recording.whole and set(np.unique(recording.column("force_1_counts"))) <= {10_000.0, 60_000.0}
    assert recording.column("hand_fx_N").max() == pytest.approx(5.0, abs=1.0)
    assert recording.outcome["link"]["force_sensor"]["name"] == "Mini45"
    window.until(lambda s: session.device().state == m.BAD)
    sensor.plugged = True
    window.until(lambda s: session.device().state == m.GOOD or s.brakes_off)

    # the loop killed while currents flow: the board's own watchdog
    killed = session.cut_short(lambda: kill(window.loop()), says="is recovered")
    assert killed.status == "recovered"
    wait_until(lambda: emulated.order()["currents_mA"] == [0] * 4)
    assert "currents zero" in [event for _, event in emulated.order()["events"]]

    # the new loop has to be led through the zero again
    sensor.counts = (1000, 0, 0, 0, 0, 0)
    window.until(lambda s: s.brakes_off or lets_go(s))  # latched, if there was current just then
    session.make_ready()
    assert len(zeros(session)) == 2

    # the board unplugged in the middle of a movement, and plugged in again
    lost = session.cut_short(lambda: emulated.order(fault="unplug"), says="")
    assert lost.status == "stopped" and " stopped: " in window.snapshot.notice
    assert read_recording(session.folder / lost.recording).whole
    wait_until(lambda: not any(emulated.order()["currents_mA"]))  # the board has a watchdog of its own
    assert to_zero_s(emulated.order(), "unplug begins") <= 0.0515
    window.until(lambda s: session.device().text == "not connected")
    emulated.order(clear=True)
    session.allow()  # latched, if there was current just then

    # brakes-off from the window, latched on the board
    window.client.brakes_off("Esc, participant's window")
    wait_until(lambda: emulated.order()["state"] == "FAULT")
    assert emulated.order()["currents_mA"] == [0] * 4
    window.until(lambda s: s.brakes_off)
    session.allow()
    assert emulated.order()["state"] in ("READY", "ACTIVE")

    # the session server killed: the loop is alone, sees it, ends its trial and says good-bye
    run, processes = session.begin(), window.processes()
    window.until(lambda s: s.stage != m.RUNNING or window.pulse.proof.rows)
    kill(window.client.pid)
    wait_until(lambda: all(map(gone, processes)))
    assert read_recording(session.folder / "trials" / f"run-{run:03}.parquet").rows, "what was recorded is there"
