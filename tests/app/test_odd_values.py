"""Valid structure, wrong values: each is one sentence, the rest is used, and no verb ends in a traceback."""

import copy
import json
import random
import re
import shutil
from pathlib import Path

import pytest
from refusals import refusal
from sessions import of, session_of

from app.cli import main
from app.session_server.session_progress import SessionProgress
from core.files import InputError
from experiments.export.results import read_results
from experiments.store.database import DATABASE, Database, reading, trials_in
from experiments.store.overview import scan_folder
from experiments.store.recording import read_recording
from experiments.store.session import Session
from experiments.store.stored import about_in, put_about

DEEP = json.loads("[" * 300 + "]" * 300)
ODD = [
    None, True, False, 0, -1, 10**30, 1e300, "", "=cmd", "1", "K1", "K99", "victory", "x" * 200_000, "\u2028\x00",
    "../x", [], {}, [1, 2], {"a": 1}, DEEP, {"x": DEEP}, ["a"],
]  # fmt: skip


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A folder with one session of six trials, one of them excluded."""
    data = tmp_path_factory.mktemp("odd") / "data"
    with session_of(data, 6) as session:
        session.exclude(1, "sneezed")
    return data


@pytest.fixture
def data(whole, tmp_path):
    """A copy to spoil."""
    return shutil.copytree(whole, tmp_path / "data")


# --------------------------------------------------------------------------- how to spoil it, with right checksums


def add_event(data: Path, name: str, about: dict, time: str = "2026-01-01T00:00:00.000+00:00") -> None:
    with Database(of(data)) as database:
        database.add("event", time, 1.0, name, json.dumps(about))


def described_as(data: Path, run: int, metadata=None, outcome=None) -> None:
    """A recording with other values in its description; its file stays as it is."""
    with reading(of(data)) as stored:
        (trial,) = (trial for trial, _ in trials_in(stored) if trial.run == run)
    about = json.loads(trial.about)
    about["metadata"] |= metadata or {}
    more = json.dumps(json.loads(trial.outcome) | (outcome or {}))
    with Database(of(data)) as database:
        database.put("trial", *trial._replace(about=json.dumps(about), outcome=more))


def stored_as(data: Path, change) -> None:
    """What is said about the session, changed."""
    with reading(of(data)) as stored:
        about = about_in(stored)
    change(about)
    with Database(of(data)) as database:
        put_about(database, about)


def said(data: Path, capsys) -> str:
    """What every verb and reader of a folder says; it must be an answer, short, and no traceback."""
    out, texts = data.parent, []
    verbs = (
        ["verify", data], ["export", data, "--csv", out / "csv", "--bids", out / "bids"],
        ["analyze", data, "--out", out / "analysis"],
        ["replay", of(data) / "trials" / "run-002.parquet", "--json"],
    )  # fmt: skip
    for verb in (*verbs, "open", ["verify", data]):
        if verb == "open":
            opened(data)
            continue
        code = main([str(word) for word in verb])
        answer = capsys.readouterr()
        assert code in (0, 1, 2) and len(answer.out + answer.err) < 12_000, verb
        assert code != 2 or answer.err.count("\n") == 1, verb
        texts.append(answer.out + answer.err)
    return texts[0]


def opened(data: Path) -> None:
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

#: Events that were added -> what is said of each.
EVENTS = (
    ("unblinded", {"who": "x", "key": {"K1": "one"}}, "key cannot be"),
    ("note", {"text": DEEP}, "text cannot be"),
    (
        "skipped", {"run": 3, "block": 1, "configuration": "three-brake", "controller": "=cmd", "path": 1,
        "repetition": 1, "reason": ""}, "controller cannot be '=cmd'",
    ),
    ("break ended", {"settled": -1}, "settled cannot be -1"),
    ("redone", {"run": 2}, "lacks reason"),
)  # fmt: skip

#: Metadata and outcome of a recording -> why it is left out.
RECORDINGS = (
    ({"run": "1"}, {}, "run cannot be '1'"),
    ({}, {"status": "victory"}, "status 'victory' is none of"),
    ({"controller": "=cmd"}, {}, "controller cannot be '=cmd'"),
    ({"path_shape": 3}, {}, "a path must be a table"),
    ({}, {"energy_residual_J": "much"}, "energy_residual_J cannot be 'much'"),
)


def analyzed(data: Path, capsys) -> dict:
    """What an analysis says of a folder."""
    assert main(["analyze", str(data), "--out", str(data.parent / "analysis"), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_events_of_odd_values_cost_themselves_alone(data, capsys):
    for name, about, _ in EVENTS:
        add_event(data, name, about)
    assert main(["verify", str(data)]) == 1
    out, summary = capsys.readouterr().out, analyzed(data, capsys)
    assert summary["trials"] == 6
    for _, _, says in EVENTS:
        assert re.search(rf"(?m)^.*{DATABASE}: event .*{re.escape(says)}", out), says
        assert any(says in warning for warning in summary["warnings"]), says
    opened(data)


def test_recordings_described_by_odd_values_are_named_and_the_others_are_used(data, capsys):
    for run, (metadata, outcome, _) in enumerate(RECORDINGS, start=2):
        described_as(data, run, metadata, outcome)
    summary = analyzed(data, capsys)
    assert summary["trials"] == 1
    for _, _, says in RECORDINGS:
        assert any(says in left for left in summary["left_out"]), says


def test_a_plan_whose_device_its_protocol_lacks_is_named_and_no_session_of_it_is_opened(data, capsys):
    stored_as(data, lambda about: about["protocol"]["devices"].pop(0))
    assert main(["verify", str(data)]) == 1
    assert f"{DATABASE}: " in capsys.readouterr().out
    with pytest.raises(InputError):
        Session.resume(data, "01", sync=False)


#: What a replay reads: changes of a recording's description, from its start -> what is said
REPLAYED = (
    (lambda start: {"configuration": "four-brakes"}, "the paper protocol .* has no .* four-brakes"),
    (lambda start: {"path": 77}, "the paper protocol of the session has no .* 77"),
    (lambda start: {"controller": 77}, "the paper protocol of the session has no .* 77"),
    (lambda start: {"start": start | {"state": 5}}, "is damaged .*'int' object"),
    (
        lambda start: {"start": start | {"state": start["state"] | {"tip": ["x"] * 4}}},
        "is damaged .*could not convert",
    ),
    (lambda start: {"start": start | {"arm": {"wing": 1.0}}}, "is damaged .*no field of name wing"),
)


def test_what_a_replay_cannot_use_is_one_sentence(data, capsys):
    path = of(data) / "trials" / "run-002.parquet"
    whole = read_recording(path).metadata
    for change, says in REPLAYED:
        described_as(data, 2, whole | change(whole["start"]))
        assert re.search(f"run-002.parquet: {says}", refusal(capsys, "replay", path, "--json")), says


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


@pytest.mark.parametrize("seed", range(2))
def test_whatever_stands_there_every_verb_answers(data, capsys, seed):
    draw = random.Random(seed)
    if seed % 2:
        stored_as(data, lambda about: spoil(about, draw))
    else:
        metadata = read_recording(of(data) / "trials" / "run-002.parquet").metadata
        spoil(metadata, draw)
        described_as(data, 2, metadata)
    said(data, capsys)
