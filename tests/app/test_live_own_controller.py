"""A controller and a measure in files of their own through the real processes: a trial of a session, and Try."""

from pathlib import Path

from live import live_window
from own_files import PROTOCOL, own_experiment

from app.ipc import messages as m
from app.ipc.messages import Setup


def test_a_session_and_try_run_a_controller_of_ones_own(tmp_path: Path) -> None:
    protocol = own_experiment(tmp_path, f'measure = "my_measure.py"\n{PROTOCOL}')
    with live_window(Setup(tmp_path / "data", str(protocol), hand="operator", sync=False)) as window:
        window.until_stage(m.NO_SESSION)
        window.client.send(m.SetSandbox())
        settings = window.until(lambda s: s.sandbox and s.sandbox.settings).sandbox.settings
        window.client.send(m.SetSandbox(settings.with_parameters(damping_N_s_m=900.0)))
        window.until(lambda s: s.sandbox.settings.values["damping_N_s_m"] == 900.0)
        window.client.send(m.EndSandbox())
        window.until(lambda s: s.sandbox is None and s.running is None)
        window.client.send(m.Open("01"))
        window.until_stage(m.READY)
        window.client.send(m.Start())
        (row,) = window.until(lambda s: s.rows).rows
        assert row.own["late_error_mm"] > 0.0 and row.failed == {}
        recording = window.recording(row.run)
        assert recording.whole and (recording.text("decision") == "damped").sum() > 100
