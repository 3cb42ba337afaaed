"""`phd replay`: through its own controller a trial comes out to the last bit, through another its hand goes on."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from disks import flip_a_bit
from exports import table
from protocols import PAPER, assuming, changed, protocol_of, short
from recorded import put_recording
from refusals import refusal
from sessions import closed_session, crash_in_trial, files, move_to_the_end, new_session, run, run_to_move, run_trials

from app.cli import main
from core import tick_log
from core.device import load_device
from core.simulator.simulated_device import SimulatedDevice, ledger_warnings
from experiments.analysis.movement import Movement
from experiments.recording import recording_columns
from experiments.store.recording import read_recording
from experiments.store.session import Participant, Session
from experiments.study.replay import A_PERSON_WOULD_REACT, OTHER_VERSION, Replacement, replay
from experiments.study.replay_motion import HAND_ENDED, read_recorded

NEAR_M = 1e-5  # a replay that has to do without the trial's start: yields of the trial before had not quite gone
BENT = 'kind = "polyline"\npoints_m = [[-0.10, 0.40], [0.0, 0.43], [0.10, 0.40]]'


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    """Both devices, a bent path, and all that can befall a trial, by a simulated operator."""
    folder = tmp_path_factory.mktemp("eventful")
    text = changed(PAPER.text, blocks="1", practice_trials="1").replace("time_out_s = 30.0", "time_out_s = 3.4", 1)
    text = text.replace('kind = "segment"\nstart_m = [-0.08, 0.26]\nend_m = [0.08, 0.42]', BENT)
    session = new_session(folder, protocol=protocol_of(assuming('sensing = "ideal"', text)))
    run_trials(session, 2)
    session.redo(2, "the phone rang")
    stop_in_the_movement(session)
    crash_in_trial(session, 3000)
    session = Session.resume(folder, "01", sync=False)
    run_trials(session, 10)
    session.close()
    return session


@pytest.fixture(scope="module")
def by_hand(tmp_path_factory):
    """A practice trial and a trial by mouse (02), and a trial by a six-axis device (03)."""
    folder = tmp_path_factory.mktemp("by-hand")
    session = Session(folder, Participant("02"), short(paths=1, practice_trials="1"), sync=False)
    for _ in range(2):
        trial, writer = session.begin(session.next_planned())
        move_to_the_end(trial, writer)
        session.finish(trial, writer)
    session.close()
    session = Session(folder, Participant("03", "hid"), short(paths=1), sync=False)
    push_through_a_trial(session)
    session.close()
    return folder


def stop_in_the_movement(session):
    trial, writer = session.begin(session.next_planned())
    run_to_move(trial, writer)
    run(trial, writer, trial.ticks + 700, 100)
    trial.abort("the participant let go")
    run(trial, writer)
    session.finish(trial, writer)


def push_through_a_trial(session):
    """A hand that is a force alone, new in each tick."""
    planned = session.next_planned()
    grip = session.simulation(planned.configuration).hand.grips
    grip["spring"][0], grip["stiffness"][0], grip["damping"][0] = 1, 0.0, 0.0
    trial, writer = session.begin(planned)
    tip, rows = trial.simulation.body["tip"][0], np.empty((1, tick_log.WIDTH))
    while not trial.finished:
        x, y = (trial.path.x0, trial.path.y0) if trial.phase in ("approach", "hold") else (trial.path.x1, trial.path.y1)
        grip["held"][0] = np.clip(3000.0 * (np.array((x, y)) - tip[:2]) - 80.0 * tip[2:], -15.0, 15.0)
        assert trial.ticks < 20_000
        writer.write(rows[: trial.run(rows)])
    session.finish(trial, writer)


def recordings(folder):
    return sorted(folder.glob("**/run-*.parquet"))


def replayed(path, **how):
    """Its summary, and what it says of equality and decisions."""
    told = replay(path, Replacement(**how))
    decisions = told["decisions"] or {"decisions": 0, "different": None}
    return told, (told["begins"], told["equal"], decisions["different"])


def test_every_trial_of_a_session_replays_to_equal_ticks_and_equal_decisions(session):
    status, devices, paths = set(), set(), recordings(session.folder)
    for path in paths:
        told, said = replayed(path)
        assert said == ("start", True, 0) and told["warnings"] == [], path
        outcome = read_recording(path).outcome
        assert told["decisions"]["decisions"] == np.count_nonzero(read_recording(path).in_phase("move"))
        if outcome["status"] != "recovered":
            assert told["after"]["status"] == outcome["status"]
            assert told["after"]["energy_residual_J"] == outcome["energy_residual_J"]
            assert outcome["warnings"] == []
        assert told["largest_tip_difference_m"] == 0.0
        assert all(metric["change"] in (0.0, None) for metric in told["metrics"].values())
        status.add(told["before"]["status"])
        devices.add(told["before"]["device"])
    assert status == {"done", "timeout", "aborted", "redone", "recovered"} and len(paths) == 14
    assert devices == {"three-brake", "four-brake"}


def test_trials_by_mouse_and_by_a_six_axis_device_replay_to_equal_ticks_too(by_hand):
    paths = recordings(by_hand)
    assert [path.parent.name for path in paths] == ["practice", "trials", "trials"]
    for path in paths:
        told, said = replayed(path)
        assert said == ("start", True, 0) and told["hand"] == "target" and told["warnings"] == [], path
        assert told["trial"] == ("practice" if path.parent.name == "practice" else "trial 1")


def copied(path, folder, change):
    """The recording in a copy of its session, changed."""
    place = shutil.copytree(path.parent.parent, folder / "sub-01" / "ses-01", dirs_exist_ok=True) / path.parent.name
    return put_recording(place / path.name, change(read_recording(path)))


def with_column(recording, name, change):
    column = recording.columns[name].copy()
    change(column)
    return replace(recording, columns={**recording.columns, name: column})


def test_a_start_that_is_another_is_told_from_the_recorded_one(session, tmp_path, capsys):
    def other(recording):
        state = dict(recording.metadata["start"]["state"])
        state["torque_yield"] = [one + 1e-9 for one in state["torque_yield"]]
        start = {**recording.metadata["start"], "state": state}
        return replace(recording, metadata={**recording.metadata, "start": start})

    path = copied(recordings(session.folder)[1], tmp_path, other)
    told, said = replayed(path)
    assert said == ("start", False, 0) and 0.0 < told["largest_tip_difference_m"] < 1e-6
    assert main(["replay", str(path), "--json"]) == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)["equal"] is False
    assert printed.err.startswith("warning: ") and "differs from the recording, first in tick " in printed.err


def test_a_decision_that_does_not_follow_from_what_is_recorded_is_counted(session, tmp_path):
    path = first_with(session, controller=4)
    move = np.flatnonzero(read_recording(path).in_phase("move"))

    def no_force(sensed):
        sensed[move] = 0.0

    def another(decision):
        decision[move[5]] = (decision[move[5]] + 1) % 26

    def more(current):
        current[move[7]] += 0.1

    for name, change, least in (("sensed_fx_N", no_force, 10), ("decision", another, 1), ("current_A_A", more, 1)):
        changed_one = copied(path, tmp_path / name, lambda r, n=name, c=change: with_column(r, n, c))
        told, said = replayed(changed_one)
        assert said[2] >= least and (least > 1 or said[2] == 1), name
        assert any("recorded decisions are not" in warning for warning in told["warnings"]), name


def without_start(recording):
    """As a version recorded it whose device had another state."""
    start = recording.metadata["start"]
    state = {name: value for name, value in start["state"].items() if name != "carry"}
    return replace(recording, metadata={**recording.metadata, "start": {**start, "state": state}})


def test_a_recording_of_another_version_is_replayed_from_its_movement_and_that_is_said(session, tmp_path, capsys):
    path = copied(recordings(session.folder)[0], tmp_path / "start", without_start)
    told, said = replayed(path)
    assert said == ("move", None, 0) and told["hand"] == "target" and told["warnings"] == [OTHER_VERSION]
    assert 0.0 < told["largest_tip_difference_m"] < NEAR_M
    assert main(["replay", str(path), "--controller", "4", "--json"]) == 0
    assert OTHER_VERSION in capsys.readouterr().err


def test_another_controller_starts_from_the_same_approach_and_makes_no_promise_of_equality(session):
    path = first_with(session, controller=1)
    told, said = replayed(path, controller="proportional, high gain")
    assert said == ("start", None, 0)
    [short] = told["warnings"]
    assert "both are measured from the start to there" in short
    assert told["largest_tip_difference_m"] > 1e-3
    told, said = replayed(path, device="four-brake")
    assert told["before"]["device"] == "three-brake" and said[:2] == ("move", None)


def test_a_ledger_that_contradicts_the_motion_is_said_by_recording_verify_and_replay(tmp_path, capsys):
    session = new_session(tmp_path, protocol=short(paths=1))
    trial, writer = session.begin(session.next_planned())
    run(trial, writer)
    trial.simulation.data.ledger["work_hand"][0] += 1.0
    session.finish(trial, writer)
    session.close()
    [path] = recordings(tmp_path)
    [doubt] = read_recording(path).outcome["warnings"]
    assert "leaves -1 J" in doubt and "the motion may be wrong" in doubt
    assert main(["verify", str(tmp_path), "--json"]) == 0
    printed = capsys.readouterr()
    name = path.relative_to(tmp_path).as_posix()
    assert json.loads(printed.out)["warnings"] == [{"file": name, "warning": doubt}]
    assert printed.err == f"warning: {name}: {doubt}\n"
    assert replay(path)["warnings"] == [f"the recording: {doubt}"]


WORLDS = {
    "brakes without drag": "drag_factor = 0.0",
    "slow brakes with drag": "lag_factor = 3.0\ndrag_factor = 2.0\nbacklash_deg = 0.0",
    "encoders": 'sensing = "encoders"\ndelay_samples = 4\nfilter_samples = 21',
    "full gap, another low gain": 'gap_reading = "full"\nlow_gain = 200.0',
}


@pytest.mark.parametrize("lines", WORLDS.values(), ids=WORLDS)
def test_a_trial_under_other_assumptions_replays_to_equal_ticks_and_equal_decisions(tmp_path, lines):
    protocol = protocol_of(assuming(lines, short(paths=1).text))
    session = closed_session(tmp_path, 1, protocol=protocol)
    for path in recordings(session.folder):
        told, said = replayed(path)
        assert said == ("start", True, 0), path
        assert read_recording(path).metadata["assumptions"] == msgspec.to_builtins(protocol.assumptions)
        assert told["warnings"] == []


def test_energy_from_a_brake_is_a_doubt_whatever_else_the_ledger_says():
    before = SimulatedDevice(PAPER.devices[0], (0.05, 0.40)).ledger()
    assert ledger_warnings(before, before) == []
    [doubt] = ledger_warnings(before, replace(before, added_by_brakes=2e-9))
    assert "a brake added 2e-09 J" in doubt
    assert len(ledger_warnings(before, replace(before, residual=float("nan")))) == 1
    moved = replace(before, work_hand=1.0, heat=(0.9, 0.0, 0.1, 0.0))
    assert ledger_warnings(before, replace(moved, residual=0.01)) == []
    assert len(ledger_warnings(before, replace(moved, residual=0.03))) == 1


# ------------------------------------------------------------------------------------ through another one, and refused


def first_with(session, **wanted):
    """The first recording whose metadata say this."""
    return next(path for path in recordings(session.folder) if wanted.items() <= read_recording(path).metadata.items())


def test_no_brake_adds_energy_and_the_ledger_closes_whatever_the_hand_is_led_through(session):
    for path in (first_with(session, controller=1), first_with(session, configuration="four-brake")):
        for asked in ((2, "three-brake"), (4, "four-brake")):
            after = replay(path, Replacement(*asked))["after"]
            assert after["energy_added_max_J"] == 0.0 and abs(after["energy_residual_J"]) < 1e-6, asked


def test_a_handle_that_cannot_follow_is_where_the_recorded_hand_ends(session):
    free = [path for path in recordings(session.folder) if read_recording(path).metadata["controller"] in (1, 5)]
    seen = [replay(path, Replacement(2)) for path in free]
    ended = [told for told in seen if told["after"]["status"] == HAND_ENDED]
    assert ended, "braked, the same hand no longer reaches the end in time"
    for told in ended:
        assert told["after"]["way_made"] < told["before"]["way_made"]
        assert told["compared_way"] == told["after"]["way_made"]
        assert any("both are measured from the start to there" in warning for warning in told["warnings"])
        trial = read_recorded(Path(told["recording"]))
        move = Movement(trial.recording, trial.path)
        there = np.argmax(move.progress >= told["compared_way"] * trial.path.length)
        assert told["metrics"]["duration_s"]["before"] == pytest.approx(there / 1000.0)
        assert told["metrics"]["peak_error_m"]["before"] == move.deviation[: there + 1].max()
    for told in seen:
        assert told["ticks"] <= read_recording(told["recording"]).rows


def test_the_ticks_have_the_recordings_columns_and_are_never_written_over_anything(session, tmp_path, capsys):
    path, out = first_with(session, controller=3), tmp_path / "out.csv"
    before = files(session.folder)
    assert main(["replay", str(path), "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert A_PERSON_WOULD_REACT in said and "path_error_m" in said
    header, *lines = table(out, ",")
    written = dict(zip(header, map(list, zip(*lines, strict=True)), strict=True))
    recording, first = read_recording(path), read_recorded(path).first
    assert header == [name for name, _ in recording_columns(recording.braked)]
    for name in ("phase", "decision", "stuck"):
        assert written[name] == list(recording.text(name)[first:])
    content = out.read_bytes()
    assert "never overwritten" in refusal(capsys, "replay", path, "--out", out)
    assert out.read_bytes() == content and files(session.folder) == before


def test_what_cannot_be_replayed_is_one_sentence_and_leaves_nothing(session, tmp_path, capsys):
    path = first_with(session, controller=1)
    spoilt = shutil.copytree(session.folder, tmp_path / "sub-01" / "ses-01") / "trials" / path.name
    flip_a_bit(spoilt)
    (tmp_path / "text.parquet").write_text("no recording")
    lonely = shutil.copy(path, tmp_path / "lonely.parquet")
    small = tmp_path / "small.toml"
    small.write_text(re.sub(r"_m = 0.(2794|3048)", "_m = 0.20", load_device("four-brake").text))
    idle = new_session(tmp_path / "idle", protocol=short(paths=1))
    trial, writer = idle.begin(idle.next_planned())
    run(trial, writer, 200, 200)
    trial.abort("enough")
    run(trial, writer)
    idle.finish(trial, writer)
    cut_off = crash_in_trial(idle, 3000)
    out = tmp_path / "out.csv"
    for asked, word in (
        ([tmp_path / "none.parquet"], "cannot be read"),
        ([tmp_path / "text.parquet"], "cannot be read"),
        ([session.folder / "trials.csv"], "cannot be read"),
        ([spoilt], "is not whole"),
        ([lonely], "cannot be read"),
        ([path, "--controller", "9"], "has no controller '9'"),
        ([path, "--device", "nobody's"], "unknown device"),
        ([path, "--device", small], "cannot follow path "),
        ([recordings(idle.folder)[0]], "never came to"),
        ([cut_off], "run-002"),
    ):
        assert word in refusal(capsys, "replay", *asked, "--out", out), asked
        assert not out.exists()


def test_a_blind_trial_is_replayed_only_through_a_controller_that_is_named(tmp_path, capsys):
    closed_session(tmp_path, 1, protocol=short(paths=1), blind=True)
    (path,) = recordings(tmp_path)
    assert "blind" in refusal(capsys, "replay", path, "--json")
    assert main(["replay", str(path), "--controller", "1", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["before"]["controller"].startswith("K") and told["metrics"]["switches_per_s"]["before"] is None
