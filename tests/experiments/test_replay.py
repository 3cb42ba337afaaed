"""`phd replay`: the hand of a recorded trial once more, through its own or another controller or device."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from disks import flip_a_bit
from exports import table
from protocols import short
from refusals import refusal
from sessions import closed_session, crash_in_trial, files, new_session, run

from app.cli import main
from core.device import load_device
from experiments.analysis.movement import Movement
from experiments.recording import recording_columns
from experiments.store.recording import read_recording
from experiments.store.session import Session
from experiments.study.replay import A_PERSON_WOULD_REACT, Replacement, replay
from experiments.study.replay_motion import HAND_ENDED, read_recorded


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """One block of one path on both devices by a simulated operator."""
    folder = tmp_path_factory.mktemp("replay")
    closed_session(folder, 10, protocol=short(paths=1, seed="2"))
    return folder


def recordings(data, participant="01"):
    return sorted((data / f"sub-{participant}" / "ses-01" / "trials").glob("*.parquet"))


def by_controller(data, controller, device="three-brake"):
    for path in recordings(data):
        about = read_recording(path).metadata
        if (about["controller"], about["configuration"]) == (controller, device):
            return path
    raise AssertionError("no such trial")


def test_no_brake_adds_energy_and_the_ledger_closes_whatever_the_hand_is_led_through(data):
    for path in (by_controller(data, 1), by_controller(data, 2, "four-brake")):
        for asked in ((2, "three-brake"), (4, "four-brake")):
            after = replay(path, Replacement(*asked))["after"]
            assert after["energy_added_max_J"] == 0.0 and abs(after["energy_residual_J"]) < 1e-6, asked


def test_a_handle_that_cannot_follow_is_where_the_recorded_hand_ends(data):
    seen = [
        replay(path, Replacement(2))
        for path in recordings(data)
        if read_recording(path).metadata["controller"] in (1, 5)
    ]
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
        assert all(metric["before"] is not None or metric["after"] is not None for metric in told["metrics"].values())
    for told in seen:
        assert told["ticks"] <= read_recording(told["recording"]).rows


def test_the_ticks_have_the_recordings_columns_and_are_never_written_over_anything(data, tmp_path, capsys):
    path, out = by_controller(data, 3), tmp_path / "out.csv"
    before = files(data)
    assert main(["replay", str(path), "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert A_PERSON_WOULD_REACT in said and "path_error_m" in said
    table = table_of(out)
    recording, first = read_recording(path), read_recorded(path).first
    assert list(table) == [name for name, _ in recording_columns(recording.braked)]
    for name in ("phase", "decision", "stuck"):
        assert table[name] == list(recording.text(name)[first:])
    content = out.read_bytes()
    assert main(["replay", str(path), "--out", str(out)]) == 2
    assert "never overwritten" in capsys.readouterr().err
    assert out.read_bytes() == content and files(data) == before


def test_what_cannot_be_replayed_is_one_sentence_and_leaves_nothing(data, tmp_path, capsys):
    path = by_controller(data, 1)
    copy = shutil.copytree(data / "sub-01", tmp_path / "sub-01") / "ses-01" / "trials"
    spoilt = copy / path.name
    cut = shutil.copytree(data / "sub-01", tmp_path / "other" / "sub-01") / "ses-01" / "trials" / path.name
    flip_a_bit(spoilt)
    cut.write_bytes(b"half")
    (tmp_path / "text.parquet").write_text("no recording")
    lonely = shutil.copy(path, tmp_path / "lonely.parquet")
    small = tmp_path / "small.toml"
    small.write_text(shrunk(load_device("four-brake").text))
    out = tmp_path / "out.csv"
    for asked, word in (
        ([str(tmp_path / "none.parquet")], "cannot be read"),
        ([str(tmp_path / "text.parquet")], "cannot be read"),
        ([str(data / "sub-01" / "ses-01" / "trials.csv")], "cannot be read"),
        ([str(spoilt)], "is not whole"),
        ([str(cut)], "is not whole"),
        ([str(lonely)], "cannot be read"),
        ([str(path), "--controller", "9"], "has no controller '9'"),
        ([str(path), "--controller", "0"], "has no controller '0'"),
        ([str(path), "--device", "nobody's"], "unknown device"),
        ([str(path), "--device", str(small)], "cannot follow path 1"),
    ):
        assert word in refusal(capsys, "replay", *asked, "--out", out), asked
        assert not out.exists()
    assert main(["replay", str(path), "--out", str(tmp_path / "none" / "out.csv")]) == 2


def test_a_trial_cut_off_by_a_crash_is_to_be_recovered_first_and_replayed_as_far_as_it_goes(tmp_path, capsys):
    session = new_session(tmp_path, protocol=short(paths=1))
    stream = crash_in_trial(session, 3000)
    assert main(["replay", str(stream), "--json"]) == 2
    Session.resume(tmp_path, "01", sync=False).close()
    capsys.readouterr()
    assert main(["replay", str(recordings(tmp_path)[0]), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["before"]["status"] == "recovered" and told["after"]["status"] == HAND_ENDED
    assert told["equal"] is True and told["warnings"] == []


def test_a_blind_trial_is_replayed_only_through_a_controller_that_is_named(tmp_path, capsys):
    closed_session(tmp_path, 1, protocol=short(paths=1), blind=True)
    path = str(recordings(tmp_path)[0])
    assert main(["replay", path, "--json"]) == 2
    assert "blind" in capsys.readouterr().err
    assert main(["replay", path, "--controller", "1", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["before"]["controller"].startswith("K") and told["metrics"]["switches_per_s"]["before"] is None


def table_of(path):
    """Column -> its cells."""
    header, *lines = table(path, ",")
    return dict(zip(header, map(list, zip(*lines, strict=True)), strict=True))


def shrunk(text):
    """A device file with shorter links."""
    for length in ("0.2794", "0.3048"):
        text = text.replace(f"_m = {length}", "_m = 0.20")
    return text


def test_a_trial_that_never_came_to_move_has_no_hand_to_replay(tmp_path, capsys):
    session = new_session(tmp_path, protocol=short(paths=1))
    trial, writer = session.begin(session.next_planned())
    run(trial, writer, 200, 200)
    trial.abort("enough")
    run(trial, writer)
    session.finish(trial, writer)
    session.close()
    assert main(["replay", str(recordings(tmp_path)[0]), "--json"]) == 2
    assert "never came to" in capsys.readouterr().err
