"""Valid structure, wrong values: each is one sentence, the rest is used, and no verb ends in a traceback."""

import copy
import csv
import json
import random
import shutil
from dataclasses import replace

import pytest
from sessions import of, session_of, without_checksums

import experiments.study.analyze as analyze_module
from app.cli import main
from app.session_server.session_progress import SessionProgress
from core.files import InputError
from experiments.export.results import read_results
from experiments.recording.reader import read_recording
from experiments.recording.writer import _parquet_bytes
from experiments.session.checksums import next_line, sealed
from experiments.session.files import STORED, write_pooled_table
from experiments.session.journal import NAME
from experiments.session.overview import scan_folder
from experiments.session.session import Session

TIME = "2026-01-01T00:00:00.000+00:00"
DEEP = json.loads("[" * 300 + "]" * 300)
ODD = [
    None, True, False, 0, -1, 10**30, 1e300, "", "=cmd", "1", "K1", "K99", "victory", "x" * 200_000, "\u2028\x00",
    "../x", [], {}, [1, 2], {"a": 1}, DEEP, {"x": DEEP}, float("nan"), float("inf"), ["a"],
]  # fmt: skip


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A folder with one session of two trials, one of them excluded."""
    data = tmp_path_factory.mktemp("odd") / "data"
    with session_of(data, 2) as session:
        session.exclude(1, "sneezed")
    write_pooled_table(data)
    return data


@pytest.fixture
def data(whole, tmp_path, monkeypatch):
    """A copy to spoil; figures and error bars take seconds and read nothing more."""
    monkeypatch.setattr(analyze_module, "draw_boxplots", lambda *_args, **_more: None)
    monkeypatch.setattr(analyze_module, "errors_in", lambda _folder: [])
    return shutil.copytree(whole, tmp_path / "data")


# ------------------------------------------------------------------------------------------------------ how to spoil it


def lines_of(data) -> list[dict]:
    """The lines of the journal, without their checksums."""
    lines = [json.loads(line) for line in (of(data) / NAME).read_bytes().splitlines()]
    return [{key: value for key, value in one.items() if key not in ("after", "crc32")} for one in lines]


def write_lines(data, lines, guarded: bool = True) -> None:
    """The journal of these lines, each with right checksums or with none."""
    journal = b""
    for line in lines:
        journal += next_line(line, journal) if guarded else json.dumps(line).encode() + b"\n"
    (of(data) / NAME).write_bytes(journal)


def stored_as(data, change, guarded: bool = True) -> None:
    """session.json, changed and with a right checksum or with none."""
    about = json.loads((of(data) / STORED).read_bytes())
    del about["crc32"]
    change(about)
    (of(data) / STORED).write_bytes(sealed(about) if guarded else json.dumps(about).encode())


def resealed(data, run: int, metadata=None, outcome=None) -> None:
    """The recording of a run with other values, whole by its checksum."""
    path = of(data) / "trials" / f"run-{run:03d}.parquet"
    recording = read_recording(path)
    more = {"metadata": recording.metadata | (metadata or {}), "outcome": recording.outcome | (outcome or {})}
    path.write_bytes(_parquet_bytes(replace(recording, **more)))


def cell_set(data, column: str, cell: str) -> None:
    """A cell of the first row of the session's table."""
    path = of(data) / "trials.csv"
    lines = list(csv.reader(path.open(newline="")))
    lines[1][lines[0].index(column)] = cell
    with path.open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(lines)


def said(data, capsys) -> str:
    """What every verb and reader of a folder says; it must be an answer, short, and no traceback."""
    out = data.parent
    texts = []
    verbs = (
        ["verify", data], ["export", data, "--csv", out / "csv", "--bids", out / "bids"],
        ["analyze", data, "--out", out / "analysis"],
        ["replay", of(data) / "trials" / "run-002.parquet", "--json"],
    )  # fmt: skip
    for verb in (*verbs, "open", ["recover", data], ["verify", data]):
        if verb == "open":
            opened(data)
            continue
        code = main([str(word) for word in verb])
        answer = capsys.readouterr()
        assert code in (0, 1, 2) and len(answer.out + answer.err) < 12_000, verb
        assert code != 2 or answer.err.count("\n") == 1, verb
        texts.append(answer.out + answer.err)
    return texts[0]


def opened(data) -> None:
    """What Home shows of the folder, what Analyse reads, and what the server does that goes on with the session."""
    scan_folder(data)
    read_results(data)
    try:
        session = Session.resume(data, "01", sync=False)
    except InputError:
        return
    try:
        session.next_planned()
        SessionProgress(session)
    finally:
        session.close()


# ------------------------------------------------------------------------------------------------------------ the cases

LINES = {
    "a key that is no number": ({"event": "unblinded", "who": "x", "key": {"K1": "one"}}, "unblinded: key cannot be"),
    "a key of no code": ({"event": "unblinded", "who": "x", "key": {"=cmd": 1}}, "unblinded: key cannot be"),
    "deep nesting": ({"event": "note", "text": DEEP}, "note: text cannot be"),
    "a controller that is a formula": (
        {"event": "skipped", "run": 3, "block": 1, "configuration": "three-brake", "controller": "=cmd", "segment": 1,
         "repetition": 1, "reason": ""}, "skipped: controller cannot be '=cmd'",
    ),
    "a time that is none": ({"event": "note", "time": "noon", "text": ""}, "note: "),
    "a run of another type": ({"event": "excluded", "run": True, "reason": ""}, "excluded: run cannot be True"),
    "a field less": ({"event": "redone", "run": 2}, "redone: lacks reason"),
}  # fmt: skip


@pytest.mark.parametrize("guarded", [True, False], ids=["", "of an earlier version"])
@pytest.mark.parametrize("line, says", LINES.values(), ids=LINES)
def test_a_journal_line_of_odd_values_costs_itself_alone(data, capsys, line, says, guarded):
    if not guarded:
        without_checksums(data)
    lines = lines_of(data)
    write_lines(data, [*lines, {"time": TIME, **line}], guarded)
    assert main(["verify", str(data)]) == 1
    assert f"{NAME}: line {len(lines) + 1}: {says}" in capsys.readouterr().out
    assert main(["recover", str(data)]) == 1
    assert f"not rescued: sub-01/ses-01/{NAME}: line {len(lines) + 1}: {says}" in capsys.readouterr().out
    assert main(["analyze", str(data), "--out", str(data.parent / "analysis"), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["trials"] == 2 and any(says in warning for warning in summary["warnings"])
    opened(data)


def test_a_line_nested_beyond_reading_costs_itself_alone(data, capsys):
    path = of(data) / NAME
    path.write_bytes(path.read_bytes() + b'{"time": ' + b"[" * 100_000 + b"]" * 100_000 + b"}\n")
    lines = len(path.read_bytes().splitlines())
    assert f"{NAME}: line {lines}: cannot be read" in said(data, capsys)


@pytest.mark.parametrize("name", [STORED, "study.json"])
def test_a_record_nested_beyond_reading_is_one_sentence(data, capsys, name):
    place = data if name == "study.json" else of(data)
    (place / name).write_bytes(b'{"a":' + b"[" * 100_000 + b"]" * 100_000 + b"}")
    assert "is damaged (nested too deeply)" in said(data, capsys)


CELLS = {
    "a cell beyond any size": ("status", "x" * 140_000, "the table cannot be read"),
    "a run that is a formula": ("run", "=cmd", "run = '=cmd' is not a number"),
    "a controller that is a formula": ("controller", "=cmd", "controller = '=cmd' is not a number"),
    "a measure that is not finite": ("duration_s", "nan", "duration_s = 'nan' is not a number"),
    "a number of 5000 digits": ("block", "9" * 5000, "is not a number"),
    "another status": ("status", "victory", "status 'victory' is none of"),
}


@pytest.mark.parametrize("column, cell, says", CELLS.values(), ids=CELLS)
def test_a_cell_of_odd_values_is_one_sentence_and_the_table_is_made_again(data, capsys, column, cell, says):
    before = (of(data) / "trials.csv").read_bytes()
    cell_set(data, column, cell)
    assert main(["verify", str(data)]) == 1
    out = capsys.readouterr().out
    assert says in out and len(out) < 2000
    assert main(["recover", str(data)]) == 0
    assert (of(data) / "trials.csv").read_bytes() == before


RECORDINGS = {
    "a run that is a text": ({"run": "1"}, {}, "run cannot be '1'"),
    "a participant that is a number": ({"participant": 7}, {}, "participant cannot be 7"),
    "another participant": ({"participant": "07"}, {}, "is of participant 07, the session of 01"),
    "another status": ({}, {"status": "victory"}, "status 'victory' is none of"),
    "a status that is a list": ({}, {"status": ["done"]}, "is none of"),
    "another controller": ({"controller": 4}, {}, "is not the trial that the journal says was begun"),
    "a trial that is not planned": ({"block": 9}, {}, "a trial that the plan does not have"),
    "a controller that is a formula": ({"controller": "=cmd"}, {}, "controller cannot be '=cmd'"),
    "a path that is a number": ({"path": 3}, {}, "a path must be a table"),
    "warnings that are a number": ({}, {"warnings": 5}, "file: damaged"),
    "an energy that is a text": ({}, {"energy_residual_J": "much"}, "energy_residual_J cannot be 'much'"),
}


@pytest.mark.parametrize("metadata, outcome, says", RECORDINGS.values(), ids=RECORDINGS)
def test_a_recording_resealed_with_odd_values_is_named_and_the_others_are_used(data, capsys, metadata, outcome, says):
    resealed(data, 2, metadata, outcome)
    assert main(["verify", str(data)]) == 1
    assert any("run-002.parquet: " in line and says in line for line in capsys.readouterr().out.splitlines())
    assert main(["analyze", str(data), "--out", str(data.parent / "analysis"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["trials"] in (1, 2)


@pytest.mark.parametrize("name", ["configuration", "segment", "controller"])
def test_a_recording_of_a_trial_that_its_session_cannot_have_is_one_sentence_of_a_replay(data, capsys, name):
    odd = {"configuration": "four-brakes", "segment": 77, "controller": 77}
    resealed(data, 2, {name: odd[name]})
    assert main(["replay", str(of(data) / "trials" / "run-002.parquet"), "--json"]) == 2
    answer = capsys.readouterr().err
    assert "run-002.parquet: the paper protocol of the session has no " in answer and f" {odd[name]}" in answer
    assert answer.count("\n") == 1


def test_a_plan_whose_device_its_protocol_lacks_is_named_and_no_session_of_it_is_opened(data, capsys):
    stored_as(data, lambda about: about["protocol"]["devices"].pop(0))
    assert main(["verify", str(data)]) == 1
    assert f"{STORED}: " in capsys.readouterr().out
    with pytest.raises(InputError):
        Session.resume(data, "01", sync=False)


STARTS = {
    "none": (lambda start: None, "'NoneType' object"),
    "of no state": (lambda start: start | {"state": 5}, "'int' object"),
    "of rows of two lengths": (lambda start: start | {"state": {"tip": [[0.0], 1.0]}}, "inhomogeneous"),
    "of texts": (lambda start: start | {"state": start["state"] | {"tip": ["x"] * 4}}, "could not convert"),
    "of an arm of texts": (lambda start: start | {"arm": {"mass": "much"}}, "could not convert"),
    "of an arm that no hand has": (lambda start: start | {"arm": {"wing": 1.0}}, "no field of name wing"),
}


@pytest.mark.parametrize("change, says", STARTS.values(), ids=STARTS)
def test_a_start_of_odd_values_is_one_sentence_of_a_replay(data, capsys, change, says):
    path = of(data) / "trials" / "run-002.parquet"
    resealed(data, 2, {"start": change(read_recording(path).metadata["start"])})
    assert main(["replay", str(path), "--json"]) == 2
    answer = capsys.readouterr()
    assert answer.out == "" and "run-002.parquet: is damaged (" in answer.err and says in answer.err
    assert answer.err.count("\n") == 1


def places(value, path=()):
    """Every place in lists and dictionaries."""
    inner = value.items() if isinstance(value, dict) else enumerate(value[:3]) if isinstance(value, list) else ()
    for key, one in inner:
        yield (*path, key)
        yield from places(one, (*path, key))


def spoil(about, draw: random.Random) -> None:
    """Take something out, or put something odd in its place."""
    *path, last = draw.choice(list(places(about)))
    for key in path:
        about = about[key]
    if draw.random() < 0.15:
        del about[last]
    else:
        about[last] = copy.deepcopy(draw.choice(ODD))


@pytest.mark.parametrize("seed", range(8))
def test_whatever_stands_there_every_verb_answers(data, capsys, seed):
    draw = random.Random(seed)
    guarded = draw.random() < 0.5
    if seed % 4 == 0:
        lines = lines_of(data)
        spoil(draw.choice(lines), draw)
        write_lines(data, lines, guarded)
    elif seed % 4 == 1:
        stored_as(data, lambda about: spoil(about, draw), guarded)
    elif seed % 4 == 2:
        cell_set(data, draw.choice(["participant", "run", "segment", "recording", "path_error_m"]), "../x")
    else:
        metadata = read_recording(of(data) / "trials" / "run-002.parquet").metadata
        spoil(metadata, draw)
        try:
            resealed(data, 2, metadata)
        except InputError:  # what no recording can hold
            return
    said(data, capsys)
