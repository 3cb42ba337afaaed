"""`phd.Session`: what a program records is a session like any other."""

import itertools
import json
import math
import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from emulated import Emulated
from protocols import changed, short

import phd
from app.cli import main
from experiments.protocol import load_protocol
from experiments.store.session import Session as StoredSession
from experiments.study.study import run_study
from experiments.trial.population import load_population

DEVICES = '["four-brake"]'


@pytest.fixture
def protocol(tmp_path: Path) -> Path:
    """Five trials, practice and consent of people among what it asks for."""
    text = short(paths=1, practice_trials="1", devices=DEVICES).text
    file = tmp_path / "mine.toml"
    file.write_text(f'{text}\n[consent]\ntext = "Take part?"\n', encoding="utf-8")
    return file


def pull(tick: phd.HandTick) -> tuple[float, float]:
    """A hand that pulls to the start, and then to the end."""
    x, y = tick.end_m if tick.phase == "move" else tick.start_m
    dx, dy, (vx, vy) = x - tick.tip_m[0], y - tick.tip_m[1], tick.velocity_m_s
    stiffness = min(1500.0, 12.0 / max(math.hypot(dx, dy), 1e-6))  # 12 N, and less near the goal
    return stiffness * dx - 15.0 * vx, stiffness * dy - 15.0 * vy


def is_ordinary(folder: Path, trials: int, capsys: pytest.CaptureFixture) -> None:
    """Verified, analysed, and a recording replays to the last digit."""
    assert main(["verify", str(folder), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["faults"] == []
    table = phd.load_trials(folder)
    assert len(table) == trials and set(table["status"]) == {"done"} and table["path_error_m"].notna().all()
    replayed = phd.replay(next(folder.glob("sub-*/ses-*/trials/run-*.parquet")))
    assert replayed.attrs["summary"]["equal"]


def test_a_function_of_the_tick_is_the_hand_of_an_ordinary_session(protocol, tmp_path, capsys):
    data, rows = tmp_path / "data", []
    with phd.Session(protocol, participant="01", folder=data) as session:
        for trial in session:
            assert trial.path_m.shape[1] == 2 and trial.controller
            rows.append(trial.run(pull))
        pd.testing.assert_frame_equal(session.trials, phd.load_trials(data))
    assert [row["run"] for row in rows] == list(range(1, 6))
    is_ordinary(data, 5, capsys)
    assert phd.load_recording(data / rows[0]["recording"]).attrs["metadata"]["hand"] == "program"


def test_a_simulated_person_makes_the_trials_of_a_study(tmp_path):
    (file := tmp_path / "short.toml").write_text(short(paths=1, devices=DEVICES).text, encoding="utf-8")
    run_study(tmp_path / "study", 1, load_protocol(file), load_population())
    with phd.Session(file, participant="01", folder=tmp_path / "data") as session:
        for trial in session:
            trial.run(phd.SimulatedPerson())
    pd.testing.assert_frame_equal(phd.load_trials(tmp_path / "data"), phd.load_trials(tmp_path / "study"))


def test_an_interrupted_block_leaves_a_session_that_goes_on(protocol, tmp_path, capsys):
    data, expected = tmp_path / "data", []
    for error in (KeyboardInterrupt, ZeroDivisionError):

        def breaks(tick: phd.HandTick, error=error) -> tuple[float, float]:
            if tick.phase == "move":
                raise error
            return pull(tick)

        with pytest.raises(error), phd.Session(protocol, folder=data) as session:
            for number, trial in enumerate(session):
                trial.run(breaks if number == 1 else pull)
        expected += ["done", "stopped"]
        assert sorted(phd.load_trials(data)["status"]) == sorted(expected)
        with StoredSession.resume(data, "01").lock:  # not held any more
            pass
    with phd.Session(protocol, folder=data) as session:
        for trial in session:
            trial.run(pull)
    table = phd.load_trials(data)
    assert sorted(table["status"].unique()) == ["done", "stopped"] and (table["status"] == "done").sum() == 5
    assert main(["verify", str(data)]) == 0
    capsys.readouterr()


def test_what_cannot_be_is_refused_in_a_sentence(protocol, tmp_path):
    data = tmp_path / "data"
    with phd.Session(protocol, folder=data) as session:
        trial = next(iter(session))
        with pytest.raises(phd.InputError, match="a phd.SimulatedPerson or a function"):
            trial.run()
        with pytest.raises(phd.InputError, match="no device to use"):
            session.home()
        with pytest.raises(phd.InputError, match="run the first trial"):
            trial.skip("x")
    assert not data.exists()
    with phd.Session(protocol, folder=data) as session:
        trials = iter(session)
        next(trials).run(pull)
        with pytest.raises(phd.InputError, match="was begun with"):
            next(trials).run(phd.SimulatedPerson())
        with pytest.raises(phd.InputError, match="was not run"):
            next(trials)
        trial = next(iter(session))
        with pytest.raises(phd.InputError, match="the force of the hand must be at most"):
            trial.run(lambda tick: (np.inf, 0.0))
        next(iter(session)).skip("too long")
    assert list(phd.load_trials(data)["status"]) == ["done", "stopped", "skipped"]
    with pytest.raises(phd.InputError, match="another protocol"), phd.Session("paper", folder=data):
        pass


def run_undisturbed(session: phd.Session, trial: phd.SessionTrial) -> pd.Series:
    """Run a trial, once a fault is gone that comes where this machine had no time for the board."""
    while True:
        try:
            return trial.run()
        except phd.InputError as error:
            if "session.reset" not in str(error):
                raise
            session.reset()


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="there are no terminals")
def test_an_emulated_device_is_run_as_a_real_one(tmp_path, capsys):
    text = changed(short(paths=1, devices=DEVICES).text, hold_s="0.1", end_radius_m="0.1", end_s="0.1")
    (file := tmp_path / "one.toml").write_text(text, encoding="utf-8")
    emulated = Emulated(tmp_path, "--hand", "operator", "--seed", "2")
    try:
        with phd.Session(file, folder=tmp_path / "data", port=emulated.port) as session:
            with pytest.raises(phd.InputError, match="session.zero"):
                run_undisturbed(session, next(iter(session)))
            emulated.order(away=True)
            session.zero()
            emulated.order(away=False)
            rows = []
            for trial in itertools.islice(session, 12):  # one that a busy machine disturbs counts for nothing
                rows.append(run_undisturbed(session, trial))
                if rows[-1]["status"] == "done":
                    break
        recordings = [phd.load_recording(tmp_path / "data" / row["recording"]) for row in rows]
        reasons = [recording.attrs["outcome"]["reason"] for recording in recordings]
        assert any(row["status"] == "done" and row["mean_tip_force_N"] > 0.0 for row in rows), reasons
    finally:
        emulated.end()
    assert main(["verify", str(tmp_path / "data")]) == 0
    capsys.readouterr()
