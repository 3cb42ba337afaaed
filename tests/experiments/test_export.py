"""`phd export`: BIDS-Motion that the official validator accepts, CSV that gives back every number; all or nothing."""

import gzip
import json
import shutil
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from disks import full
from exports import errors, table, validate
from protocols import protocol_of, short
from recorded import record as recorded
from recorded import ticks
from refusals import refusal
from sessions import closed_session, crash_in_trial, files, new_session, run

from app.cli import main
from core import tick_log
from core.files import InputError
from experiments.analysis.trials_table import COLUMNS, DICTIONARY, TrialRow, row_of
from experiments.export.export import CsvTables, export
from experiments.export.files import recording_column
from experiments.recording import Sensors, recording_columns
from experiments.store.database import Database
from experiments.store.files import add_row, pooled_rows, put_row, rows_of
from experiments.store.recording import read_recording
from experiments.store.session import Participant, Session
from experiments.store.stored import put_about
from tests.support.rows import read_rows

SESSION = Path("sub-01", "ses-01")


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """Three trials of a simulated operator, and one of a person at the mouse, on a device with a name of its own."""
    data = tmp_path_factory.mktemp("export") / "study"
    closed_session(data, 3)
    mouse_trial(data)
    return data


def mouse_trial(data, hand="mouse"):
    """A recording of a person at the mouse: late ticks, a brake that gave no number, a number that only repr keeps."""
    folder = data / "sub-p7" / "ses-01"
    rows = ticks(900, seed=7)
    rows[:, tick_log.LATENESS_US] = np.abs(rows[:, tick_log.LATENESS_US])
    rows[5, tick_log.TORQUE] = np.nan
    rows[6, tick_log.TORQUE] = np.inf
    rows[7, tick_log.TORQUE : tick_log.TORQUE + 4] = 0.1 + 0.2, -0.0, 5e-324, 1.7976931348623157e308
    about = dict(participant="p7", run=104, block=1, configuration="my five-bar 2", controller=2, path=1)
    path = {"kind": "segment", "start_m": [-0.1, 0.4], "end_m": [0.1, 0.4]}
    metadata = {**about, "repetition": 1, "start_m": [-0.1, 0.4], "end_m": [0.1, 0.4], "path_shape": path, "hand": hand}
    outcome = {"status": "timeout", "reason": "time was up"}
    path = recorded(folder, rows, "AEBC", outcome, metadata=metadata, run=104)
    with Database(folder) as database:
        put_about(database, {"participant": "p7"})
        add_row(database, row_of(read_recording(path), folder))


@pytest.fixture(scope="module")
def exported(study, tmp_path_factory):
    """The same study as BIDS and as CSV: form -> folder."""
    out = tmp_path_factory.mktemp("exported")
    outs = {"bids": out / "bids", "csv": out / "csv"}
    before = files(study)
    summary = export(study, outs)
    assert files(study) == before and summary["left_out"] == [] and summary["trials"] == 4
    return outs


def recordings(study):
    return [read_recording(path) for path in sorted(study.glob("sub-*/ses-*/trials/run-*.parquet"))]


def same_bits(texts, numbers, missing):
    """The texts stand for these doubles, bit by bit; `missing` for one that is not finite."""
    finite = np.isfinite(numbers)
    assert [text == missing for text in texts] == (~finite).tolist()
    back = np.array([float(text) for text in texts if text != missing])
    return np.array_equal(back.view("u8"), np.asarray(numbers, dtype=float)[finite].view("u8"))


def test_the_official_validator_finds_no_error_and_misses_only_what_the_experimenter_alone_knows(exported, tmp_path):
    assert validate(exported["bids"]) <= {
        ("warning", "TOO_FEW_AUTHORS", ""),
        ("warning", "NO_AUTHORS", "Authors"),
        ("warning", "JSON_KEY_RECOMMENDED", "License"),
        ("warning", "JSON_KEY_RECOMMENDED", "SourceDatasets"),
        ("warning", "JSON_KEY_RECOMMENDED", "HEDVersion"),
    }
    folder = shutil.copytree(exported["bids"], tmp_path / "bids")
    channels = next(folder.rglob("*_channels.tsv"))
    channels.write_text(channels.read_text().replace("LATENCY", "TIME"))
    assert errors(folder), "the validator does find an error where there is one"


def test_what_the_protocol_says_of_the_data_set_stands_in_it_and_the_validator_no_longer_asks_for_it(tmp_path):
    protocol = short(paths=1)
    said = '\n[export]\nauthors = ["A. Author", "B. Author"]\nlicense = "CC0-1.0"\nhed_version = "8.3.0"\n'
    data, out = tmp_path / "data", tmp_path / "bids"
    closed_session(data, 1, protocol=protocol_of(protocol.text + said))
    export(data, {"bids": out})
    about = json.loads((out / "dataset_description.json").read_text())
    assert about["Authors"] == ["A. Author", "B. Author"]
    assert (about["License"], about["HEDVersion"]) == ("CC0-1.0", "8.3.0")
    assert validate(out) <= {("warning", "JSON_KEY_RECOMMENDED", "SourceDatasets")}
    closed_session(data, 1, participant="02", protocol=protocol)
    with pytest.raises(InputError, match=r"their protocols differ in \[export\]"):
        export(data, {"bids": tmp_path / "both"})
    assert not (tmp_path / "both").exists()


def test_shifted_dates_lie_before_1925_and_keep_time_of_day_and_what_is_between(study, exported, tmp_path, capsys):
    out = tmp_path / "shifted"
    assert main(["export", str(study), "--bids", str(out), "--shift-dates"]) == 0
    [place] = [path.relative_to(out) for path in out.glob("sub-01/ses-*/*_scans.tsv")]
    head, *real = table(exported["bids"] / place)
    column = head.index("acq_time")
    real, shifted = (
        [datetime.fromisoformat(line[column]) for line in lines] for lines in (real, table(out / place)[1:])
    )
    [days] = {then - now for then, now in zip(real, shifted, strict=True)}
    assert days.seconds == days.microseconds == 0 and all(now.year < 1925 for now in shifted)
    assert "shifted to before 1925" in (out / "README.md").read_text() and not errors(out)
    for path in out.rglob("*.*"):
        assert str(real[0].date()) not in path.read_text(), path
    for more in (["--csv", "c"], ["--csv", "c", "--bids", "b"]):
        assert "--shift-dates: is for --bids" in refusal(capsys, "export", study, "--shift-dates", *more)


def test_every_number_of_a_recording_comes_back_from_its_bids_files(study, exported):
    for recording in recordings(study):
        session = exported["bids"] / recording.path.parent.parent.relative_to(study)
        [motion] = session.glob(f"motion/*_run-{recording.metadata['run']:02d}_motion.tsv")
        stem = str(motion).removesuffix("_motion.tsv")
        header, *channels = table(Path(f"{stem}_channels.tsv"))
        names = [line[header.index("name")] for line in channels]
        columns = dict(zip(names, zip(*table(motion), strict=True), strict=True))
        about = json.loads(Path(f"{stem}_motion.json").read_text())

        bits = zip(*(columns[f"stuck_{joint}"] for joint in recording.braked), strict=True)
        letters = ["".join(np.array(list(recording.braked))[np.array(tick) == "1"]) for tick in bits]
        assert letters == recording.text("stuck").tolist()
        assert [about["Decisions"][code] for code in columns["decision"]] == recording.text("decision").tolist()
        time = np.array(columns["t_s"], dtype=float)
        assert np.abs(time - recording.column("t_s")).max() <= 0.5e-6
        events = table(Path(f"{stem}_events.tsv"))[1:]
        onsets = np.array([float(onset) for onset, _, _ in events])
        phases = [events[k][2] for k in np.searchsorted(onsets, time, side="right") - 1]
        assert phases == recording.text("phase").tolist()
        assert sum(float(duration) for _, duration, _ in events) == pytest.approx(recording.rows / 1000.0)
        numbers = set(recording.columns) - {"t_s", "phase", "stuck", "decision"}
        assert numbers == set(names) - {"t_s", "decision"} - {f"stuck_{j}" for j in recording.braked}
        for name in numbers:
            assert same_bits(columns[name], recording.column(name), "n/a"), name

        kinds = [line[header.index("type")] for line in channels]
        for kind in ("POS", "VEL", "ACCEL", "LATENCY", "MISC"):
            assert about[f"{kind}ChannelCount"] == kinds.count(kind)
        for name, value in recording.metadata.items():
            assert about["Trial"][name] == value


def test_every_number_of_a_recording_comes_back_from_its_csv_file(study, exported):
    for recording in recordings(study):
        place = recording.path.parent.parent.relative_to(study) / recording.path.name
        header, *lines = table((exported["csv"] / place).with_suffix(".csv"), ",")
        columns = dict(zip(header, zip(*lines, strict=True), strict=True))
        assert header == list(recording.columns)
        for name in header:
            if name in recording.words:
                assert list(columns[name]) == recording.text(name).tolist()
            else:
                assert same_bits(columns[name], recording.column(name), ""), name
        about = json.loads((exported["csv"] / place).with_suffix(".json").read_text())
        assert (about["trial"], about["outcome"]) == (recording.metadata, recording.outcome)


def test_a_compressed_export_holds_the_same_bytes(study, exported, tmp_path):
    """Recordings as .csv.gz, everything else as it was but for their names; twice the same."""
    one, two = tmp_path / "one", tmp_path / "two"
    for out in (one, two):
        export(study, {"csv": out}, compress=True)
    plain, found = files(exported["csv"]), files(one)
    assert found == files(two)
    unpacked = {name.removesuffix(".gz"): gzip.decompress(data) for name, data in found.items() if name.endswith(".gz")}
    assert unpacked == {
        name: data for name, data in plain.items() if Path(name).name.startswith("run-") and ".csv" in name
    }
    assert read_rows(one / "trials.csv")[0].recording.endswith("run-001.csv.gz")
    assert "sub-*/ses-*/run-*.csv.gz" in json.loads((one / "columns.json").read_text())
    assert sorted(name for name in found if name.endswith(".json")) == sorted(n for n in plain if n.endswith(".json"))


def test_the_tables_hold_the_rows_of_the_study(study, exported):
    rows = read_rows(exported["csv"] / "trials.csv")
    assert [replace(r, recording="") for r in rows[:3]] == [replace(r, recording="") for r in pooled_rows(study)[:3]]
    assert all((exported["csv"] / r.recording).exists() for r in rows)
    scans = [line for path in sorted(exported["bids"].rglob("*_scans.tsv")) for line in table(path)[1:]]
    lines = [[cell or "n/a" for cell in line] for line in table(exported["csv"] / "trials.csv", ",")[1:]]
    place = COLUMNS.index("recording")
    assert [line[2:] for line in scans] == [line[1:place] + line[place + 1 :] for line in lines]
    for path in exported["bids"].rglob("*_scans.tsv"):
        assert all((path.parent / line[0]).exists() for line in table(path)[1:])
    assert all(line[1].endswith("Z") for line in scans[:3]) and scans[3][1] == "n/a"
    people = {line[0]: line[-1] for line in table(exported["bids"] / "participants.tsv")[1:]}
    assert people == {"sub-01": "operator", "sub-p7": "mouse"}


def test_every_column_that_can_be_recorded_or_tabled_is_described_with_its_unit(exported):
    # longer ends first: they hold shorter ones
    units = {"_N_per_m": "N/m", "_N_m": "N m", "_m_s2": "m/s^2", "_m_s": "m/s", "_us": "us"}
    units |= {"_s": "s", "_m": "m", "_N": "N", "_A": "A", "_J": "J"}
    names = [name for name, _ in recording_columns("AEBC")]
    for name in names:
        said = [unit for end, unit in units.items() if name.endswith(end)]
        assert recording_column(name).unit == (said[0] if said else "") and recording_column(name).meaning
    assert [name for name, column in DICTIONARY.items() if column.meaning] == list(COLUMNS)
    described = json.loads((exported["csv"] / "columns.json").read_text())
    assert set(described["trials.csv"]) == set(COLUMNS)
    ours = described["sub-*/ses-*/run-*.csv"]
    assert set(ours) == set(names) and "joint C" in ours["torque_C_N_m"]["description"]
    field = recording_column("current_A_A", "kV/mm")
    assert (field.unit, field.meaning) == ("kV/mm", "value (kV/mm) commanded to the brake at joint A")
    assert recording_column("tip_x_m", "kV/mm") == recording_column("tip_x_m")


def test_what_is_damaged_or_not_finished_is_left_out_and_named(study, tmp_path, capsys):
    folder = shutil.copytree(study, tmp_path / "copy")
    path = folder / SESSION / "trials" / "run-002.parquet"
    path.write_bytes(path.read_bytes()[:-1000])
    (folder / SESSION / "trials" / "run-003.parquet").unlink()
    crash_in_trial(Session.resume(folder, "01", sync=False))
    outs = {"bids": tmp_path / "bids", "csv": tmp_path / "csv"}
    assert main(["export", str(folder), "--bids", str(outs["bids"]), "--csv", str(outs["csv"]), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["trials"] == 2 and len(said["left_out"]) == 3
    for number, why in (("002", "changed or cut"), ("003", "missing"), ("004", "cut off")):
        [entry] = [entry for entry in said["left_out"] if f"run-{number}" in entry]
        assert why in entry
        assert all(entry in (out / "README.md").read_text() for out in outs.values())
    assert [r.run for r in read_rows(outs["csv"] / "trials.csv")] == [1, 104]
    assert not [name for name in files(outs["bids"]) if "run-02" in name or "run-03" in name]


@pytest.mark.parametrize("existing", [False, True])
def test_an_export_that_fails_leaves_nothing(study, tmp_path, monkeypatch, existing):
    monkeypatch.setattr(CsvTables, "finish", full)
    here = tmp_path / "here"
    here.mkdir()
    outs = {"bids": here / "bids", "csv": here / "csv"}
    if existing:
        outs["csv"].mkdir()
    before = sorted(here.rglob("*"))
    with pytest.raises(OSError, match="given up"):
        export(study, outs)
    assert sorted(here.rglob("*")) == before


def test_wrong_input_is_one_sentence_and_nothing_is_written(study, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    full = tmp_path / "full"
    full.mkdir()
    (full / "note.txt").write_text("mine")
    hollow = shutil.copytree(study, tmp_path / "hollow")
    for path in hollow.rglob("*.parquet"):
        path.write_bytes(b"")
    before = files(tmp_path)
    wrong = {
        "--compress: is for --csv": ["export", str(study), "--bids", "out", "--compress"],
        "is not empty": ["export", str(study), "--bids", str(full)],
        "neither inside the other": ["export", str(study), "--bids", "out", "--csv", "out/csv"],
        "two folders": ["export", str(study), "--bids", "out", "--csv", "./out"],
        "none of its recordings": ["export", str(hollow), "--csv", "out"],
        "cannot be created": ["export", str(study), "--csv", str(full / "note.txt" / "out")],
    }
    for sentence, arguments in wrong.items():
        assert sentence in refusal(capsys, *arguments)
        assert files(tmp_path) == before and not (tmp_path / "out").exists()
    inside = tmp_path / "inside"  # a new folder in its place would leave the shell in one that is gone
    inside.mkdir()
    monkeypatch.chdir(inside)
    assert "is the folder you are in" in refusal(capsys, "export", str(study), "--csv", ".")
    assert "is not empty" in refusal(capsys, "export", str(study), "--csv", "/") and inside.samefile(".")


def on_the_bench(session: Session, board: str) -> None:
    """One trial on a device on the bench that never got to its movement."""
    trial, writer = session.begin(session.next_planned(), Sensors("AB", 6))
    rows = np.full((300, tick_log.BENCH_WIDTH), np.nan)
    rows[:, tick_log.T] = np.arange(300) / 1000.0
    rows[:, [tick_log.PHASE, tick_log.STUCK, tick_log.DECISION, tick_log.FILLED]] = 0.0
    rows[:, tick_log.COUNT : tick_log.COUNT + 4] = 1234.0
    writer.write(rows)
    trial.connect(SimpleNamespace(end_record=lambda: {"link": {"board": board} if board else {}}))
    session.finish(trial, writer)


def record(data: Path, kind: str) -> None:
    """A session of one trial."""
    if kind == "operator":
        session = new_session(data)
    else:
        hand = "mouse" if kind.startswith("serial") else kind
        session = Session(data, Participant("01", hand), short(), sync=False)
    if kind.startswith("serial"):
        on_the_bench(session, kind.partition(" ")[2])
    else:
        trial, writer = session.begin(session.next_planned())
        if kind != "operator":
            run(trial, writer, 200)
            trial.abort("nobody at the handle")
        run(trial, writer)
        session.finish(trial, writer)
    session.close()


#: kind of recording -> hand, words of its level, simulated device, simulated operator, number of the board
KINDS = {
    "operator": ("operator", "simulated operator", True, True, "n/a"),
    "mouse": ("mouse", "with the mouse", True, False, "n/a"),
    "serial A17": ("force sensor", "on the bench", False, False, "A17"),
    "serial": ("force sensor", "on the bench", False, False, "unknown"),
}


@pytest.mark.parametrize("kind", KINDS)
def test_hand_and_device_of_a_recording_stand_in_its_export(tmp_path: Path, kind: str) -> None:
    hand, words, simulated_device, simulated_operator, number = KINDS[kind]
    record(tmp_path / "data", kind)
    export(tmp_path / "data", {"bids": tmp_path / "bids", "csv": tmp_path / "csv"})
    bids = tmp_path / "bids"
    about = json.loads(next(bids.glob("sub-01/ses-01/motion/*_motion.json")).read_text())
    assert (about["SimulatedDevice"], about["SimulatedOperator"]) == (simulated_device, simulated_operator)
    assert about["DeviceSerialNumber"] == number and about["Trial"]["hand"] == hand
    header, person = table(bids / "participants.tsv")
    assert dict(zip(header, person, strict=True))["hand"] == hand
    levels = json.loads((bids / "participants.json").read_text())["hand"]["Levels"]
    assert list(levels) == [hand] and words in levels[hand]
    assert kind != "serial A17" or not errors(bids)  # the others have no other files


def test_authors_and_licence_of_the_command_are_kept_for_the_next_export(study, tmp_path):
    def described(*options: str) -> dict:
        out = tmp_path / f"bids-{len(list(tmp_path.iterdir()))}"
        assert main(["export", str(study), "--bids", str(out), *options]) == 0
        about = json.loads((out / "dataset_description.json").read_text())
        return {key: about.get(key) for key in ("Authors", "License")}

    said = {"Authors": ["A. Author", "B. Author"], "License": "CC0-1.0"}
    assert described("--author", "A. Author", "--author", "B. Author", "--licence", "CC0-1.0") == said
    assert described("--author", "C. Author") == {"Authors": ["C. Author"], "License": "CC0-1.0"} == described()


def test_a_trial_that_was_redone_or_never_recorded_stands_as_the_sessions_table_says(study, tmp_path):
    folder = shutil.copytree(study, tmp_path / "copy")
    empty = TrialRow("01", 50, 1, "three-brake", 1, 1, 1, "aborted")
    with Database(folder / SESSION) as database:
        put_row(database, replace(rows_of(folder / SESSION)[0], status="redone"), 1)
        add_row(database, empty)
    out = tmp_path / "csv"
    export(folder, {"csv": out})
    rows = read_rows(out / "trials.csv")
    assert [r.run for r in rows] == [1, 2, 3, 50, 104]
    assert [r.status for r in rows] == ["redone", "done", "done", "aborted", "timeout"]
    assert rows[3].recording == ""
    assert json.loads((out / SESSION / "run-001.json").read_text())["outcome"]["status"] == "redone"
