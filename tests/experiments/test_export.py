"""`phd export`: BIDS-Motion that the official validator accepts, CSV that gives back every number; all or nothing."""

import gzip
import json
import math
import shutil
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from exports import rows, table, validate
from protocols import protocol_of, short
from recorded import record as recorded
from recorded import ticks
from refusals import refusal
from rows import read_rows
from scipy import signal
from sessions import closed_session, crash_in_trial, files, new_session

from app.cli import main
from app.window.participant.questionnaire import ITEMS
from core import tick_log
from core.files import InputError
from experiments.analysis.trials_table import COLUMNS, TrialRow, row_of
from experiments.export.export import export
from experiments.export.files import (
    NOTES_CSV,
    QUESTIONNAIRE_CSV,
    answers_and_notes,
    recording_column,
    write_answers_and_notes,
    write_phenotype,
)
from experiments.recording import Sensors, recording_columns
from experiments.store.database import Database
from experiments.store.files import add_row, pooled_rows, put_row, rows_of
from experiments.store.journal import ANSWERS, CONTROLLER_ANSWERS
from experiments.store.recording import read_recording
from experiments.store.session import Participant, Session
from experiments.store.stored import put_about, read_stored

SESSION = Path("sub-01", "ses-01")
SAID = """
[export]
authors = ["A. Author", "B. Author"]
license = "CC0-1.0"
hed_version = "8.3.0"
[form]
handedness = ["right", "left"]
age = "number"
first_time = ["yes", "no"]
remarks = "text"
"""
PROTOCOL = protocol_of(short(paths=1).text + SAID)
FORM = {"handedness": "left", "age": 27.0, "first_time": "yes", "remarks": "a, b"}
SCALES = [item for item, *_ in ITEMS]
FIRST, SECOND = (dict(zip(SCALES, (5.0 * (n + i) for i in range(7)), strict=True)) for n in (1, 4))
NOTE = 'said: "too hard", asked for a pause,\nthen went on'


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """Sessions of all kinds: a simulated operator's three trials with answers and a note, a person at the mouse on a
    device with a name of its own, two on the bench of whom one has filled in a form, and one who did not come.
    """
    data = tmp_path_factory.mktemp("export") / "study"
    closed_session(data, 3, protocol=PROTOCOL)
    session = Session.resume(data, "01", sync=False)
    session.note(NOTE)
    for block, values in ((1, FIRST), (2, SECOND)):
        session.journal(ANSWERS, configuration="three-brake", block=block, values=values)
    session.close()
    mouse_trial(data)
    on_the_bench(data, "b1", "A17", FORM)
    on_the_bench(data, "b2", "", {})
    absent = new_session(data, "x", protocol=PROTOCOL)
    absent.note("did not come")
    absent.close()
    return data


def on_the_bench(data: Path, participant: str, board: str, form: dict) -> None:
    """One trial on a device on the bench that never got to its movement. board: its number, if it told one."""
    session = Session(data, Participant(participant, form=form), PROTOCOL, sync=False)
    trial, writer = session.begin(session.next_planned(), Sensors("AB", 6))
    rows = np.full((300, tick_log.BENCH_WIDTH), np.nan)
    rows[:, tick_log.T] = np.arange(300) / 1000.0
    rows[:, [tick_log.PHASE, tick_log.STUCK, tick_log.DECISION, tick_log.FILLED]] = 0.0
    rows[:, tick_log.COUNT : tick_log.COUNT + 4] = 1234.0
    writer.write(rows)
    trial.connect(SimpleNamespace(end_record=lambda: {"link": {"board": board} if board else {}}))
    session.finish(trial, writer)
    session.close()


def mouse_trial(data):
    """A recording of a person at the mouse: late ticks, a brake that gave no number, a number that only repr keeps."""
    folder = data / "sub-p7" / "ses-01"
    rows = ticks(900, seed=7)
    rows[:, tick_log.LATENESS_US] = np.abs(rows[:, tick_log.LATENESS_US])
    rows[5, tick_log.TORQUE] = np.nan
    rows[6, tick_log.TORQUE] = np.inf
    rows[7, tick_log.TORQUE : tick_log.TORQUE + 4] = 0.1 + 0.2, -0.0, 5e-324, 1.7976931348623157e308
    about = dict(participant="p7", run=104, block=1, configuration="my five-bar 2", controller=2, path=1)
    path = {"kind": "segment", "start_m": [-0.1, 0.4], "end_m": [0.1, 0.4]}
    metadata = {
        **about,
        "repetition": 1,
        "start_m": [-0.1, 0.4],
        "end_m": [0.1, 0.4],
        "path_shape": path,
        "hand": "mouse",
    }
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
    assert files(study) == before and summary["left_out"] == [] and summary["trials"] == 6
    return outs


def recordings(study):
    return [read_recording(path) for path in sorted(study.glob("sub-*/ses-*/trials/run-*.parquet"))]


def same_bits(texts, numbers, missing):
    """The texts stand for these doubles, bit by bit; `missing` for one that is not finite."""
    finite = np.isfinite(numbers)
    assert [text == missing for text in texts] == (~finite).tolist()
    back = np.array([float(text) for text in texts if text != missing])
    return np.array_equal(back.view("u8"), np.asarray(numbers, dtype=float)[finite].view("u8"))


def test_the_official_validator_finds_no_error_and_misses_only_what_is_not_there(exported):
    assert validate(exported["bids"]) == {("warning", "JSON_KEY_RECOMMENDED", "SourceDatasets")}


def test_what_the_protocol_says_of_the_data_set_stands_in_it_unless_protocols_differ(study, exported, tmp_path):
    about = json.loads((exported["bids"] / "dataset_description.json").read_text())
    assert about["Authors"] == ["A. Author", "B. Author"]
    assert (about["License"], about["HEDVersion"]) == ("CC0-1.0", "8.3.0")
    data = tmp_path / "data"
    shutil.copytree(study / "sub-01", data / "sub-01")
    new_session(data, "02", short(paths=1)).close()
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
    assert "shifted to before 1925" in (out / "README.md").read_text()
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
    """Recordings as .csv.gz, everything else as it was but for their names."""
    export(study, {"csv": tmp_path / "out"}, compress=True)
    plain, found = files(exported["csv"]), files(tmp_path / "out")
    unpacked = {name.removesuffix(".gz"): gzip.decompress(data) for name, data in found.items() if name.endswith(".gz")}
    recordings = {name for name in plain if Path(name).name.startswith("run-") and name.endswith(".csv")}
    assert unpacked == {name: plain[name] for name in recordings}
    assert read_rows(tmp_path / "out" / "trials.csv")[0].recording.endswith("run-001.csv.gz")
    assert "sub-*/ses-*/run-*.csv.gz" in json.loads(found["columns.json"])
    assert {name for name in found if name.endswith(".json")} == {name for name in plain if name.endswith(".json")}


def test_the_tables_hold_the_rows_of_the_study_its_hands_and_its_forms(study, exported):
    rows = read_rows(exported["csv"] / "trials.csv")
    with_protocol = [replace(row, recording="") for row in pooled_rows(study) if row.participant != "p7"]
    assert [replace(row, recording="") for row in rows if row.participant != "p7"] == with_protocol
    assert all((exported["csv"] / r.recording).exists() for r in rows)
    scans = [line for path in sorted(exported["bids"].rglob("*_scans.tsv")) for line in table(path)[1:]]
    lines = [[cell or "n/a" for cell in line] for line in table(exported["csv"] / "trials.csv", ",")[1:]]
    place = COLUMNS.index("recording")
    assert [line[2:] for line in scans] == [line[1:place] + line[place + 1 :] for line in lines]
    for path in exported["bids"].rglob("*_scans.tsv"):
        assert all((path.parent / line[0]).exists() for line in table(path)[1:])
    times = [line[1] for line in scans]
    assert all(time.endswith("Z") for time in times[:-1]) and times[-1] == "n/a"
    header, *people = table(exported["bids"] / "participants.tsv")
    assert header == ["participant_id", "species", "age", "sex", "handedness", "first_time", "remarks", "hand"]
    assert [line for line in people if line[0] != "sub-x"] == [
        ["sub-01", *["n/a"] * 6, "operator"],
        ["sub-b1", "n/a", "27", "n/a", "left", "yes", "a, b", "force sensor"],
        ["sub-b2", *["n/a"] * 6, "force sensor"],
        ["sub-p7", *["n/a"] * 6, "mouse"],
    ]
    about = json.loads((exported["bids"] / "participants.json").read_text())
    assert list(about["handedness"]["Levels"]) == ["right", "left"] and "Levels" not in about["age"]
    words = {"operator": "simulated operator", "mouse": "with the mouse", "force sensor": "on the bench"}
    assert all(words[hand] in said for hand, said in about["hand"]["Levels"].items())
    assert read_stored(study / "sub-b1" / "ses-01").about["form"] == FORM


@pytest.mark.parametrize(
    ("participant", "simulated_device", "simulated_operator", "number"),
    [
        ("01", True, True, "n/a"),
        ("p7", True, False, "n/a"),
        ("b1", False, False, "A17"),
        ("b2", False, False, "unknown"),
    ],
)
def test_the_device_of_a_recording_stands_in_its_export(
    exported, participant: str, simulated_device: bool, simulated_operator: bool, number: str
):
    about = json.loads(next(exported["bids"].glob(f"sub-{participant}/ses-01/motion/*_motion.json")).read_text())
    assert (about["SimulatedDevice"], about["SimulatedOperator"]) == (simulated_device, simulated_operator)
    assert about["DeviceSerialNumber"] == number


def test_a_column_has_the_unit_that_its_name_ends_with_or_that_of_the_devices_commands():
    # longer ends first: they hold shorter ones
    units = {"_N_per_m": "N/m", "_N_m": "N m", "_m_s2": "m/s^2", "_m_s": "m/s", "_us": "us"}
    units |= {"_s": "s", "_m": "m", "_N": "N", "_A": "A", "_J": "J"}
    for name, _ in recording_columns("AEBC"):
        said = [unit for end, unit in units.items() if name.endswith(end)]
        assert recording_column(name).unit == (said[0] if said else "") and recording_column(name).meaning
    field = recording_column("current_A_A", "kV/mm")
    assert (field.unit, field.meaning) == ("kV/mm", "value (kV/mm) commanded to the brake at joint A")


def test_what_is_damaged_or_not_finished_is_left_out_and_named(study, tmp_path, capsys):
    folder = shutil.copytree(study, tmp_path / "copy")
    path = folder / SESSION / "trials" / "run-002.parquet"
    path.write_bytes(path.read_bytes()[:-1000])
    (folder / SESSION / "trials" / "run-003.parquet").unlink()
    crash_in_trial(Session.resume(folder, "01", sync=False))
    assert main(["export", str(folder), "--csv", str(tmp_path / "csv"), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["trials"] == 4 and len(said["left_out"]) == 3
    for number, why in (("002", "changed or cut"), ("003", "missing"), ("004", "cut off")):
        [entry] = [entry for entry in said["left_out"] if f"run-{number}" in entry]
        assert why in entry and entry in (tmp_path / "csv" / "README.md").read_text()
    assert [r.run for r in read_rows(tmp_path / "csv" / "trials.csv")] == [1, 1, 1, 104]
    assert not [name for name in files(tmp_path / "csv") if "run-002" in name or "run-003" in name]


@pytest.fixture
def no_large_files():
    """The system refuses every file over 50 kB, as a full disk does."""
    resource = pytest.importorskip("resource")  # Windows has none
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("existing", [False, True])
def test_an_export_that_fails_leaves_nothing(study, tmp_path, no_large_files, existing):
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


def test_authors_and_licence_of_the_command_are_kept_for_the_next_export(study, tmp_path):
    data = shutil.copytree(study / "sub-p7", tmp_path / "data" / "sub-p7").parent  # whose protocol says nothing

    def described(*options: str) -> dict:
        out = tmp_path / f"bids-{len(list(tmp_path.iterdir()))}"
        assert main(["export", str(data), "--bids", str(out), *options]) == 0
        about = json.loads((out / "dataset_description.json").read_text())
        return {key: about.get(key) for key in ("Authors", "License")}

    said = {"Authors": ["A. Author", "B. Author"], "License": "CC0-1.0"}
    assert described("--author", "A. Author", "--author", "B. Author", "--licence", "CC0-1.0") == said
    assert described("--author", "C. Author") == {"Authors": ["C. Author"], "License": "CC0-1.0"} == described()


def test_a_trial_that_was_redone_or_never_recorded_stands_as_the_sessions_table_says(study, tmp_path):
    shutil.copytree(study / "sub-01", tmp_path / "copy" / "sub-01")
    empty = TrialRow("01", 50, 1, "three-brake", 1, 1, 1, "aborted")
    folder = tmp_path / "copy" / SESSION
    with Database(folder) as database:
        put_row(database, replace(rows_of(folder)[0], status="redone"), 1)
        add_row(database, empty)
    export(tmp_path / "copy", {"csv": tmp_path / "csv"})
    rows = read_rows(tmp_path / "csv" / "trials.csv")
    assert [(r.run, r.status) for r in rows] == [(1, "redone"), (2, "done"), (3, "done"), (50, "aborted")]
    assert rows[3].recording == ""
    outcome = json.loads((tmp_path / "csv" / SESSION / "run-001.json").read_text())["outcome"]
    assert outcome["status"] == "redone"


# ------------------------------------------------------------------------------------------------- answers and notes


def test_answers_and_notes_are_tables_of_their_own_and_described(exported):
    out = exported["csv"]
    answers, notes = rows(out / QUESTIONNAIRE_CSV), rows(out / NOTES_CSV)
    assert [(a["participant"], a["configuration"], a["block"]) for a in answers] == [
        ("01", "three-brake", "1"), ("01", "three-brake", "2"),
    ]  # fmt: skip
    assert [{scale: float(a[scale]) for scale in SCALES} for a in answers] == [FIRST, SECOND]
    assert [(note["participant"], note["text"]) for note in notes] == [("01", NOTE), ("x", "did not come")]
    assert all(note["time"].endswith("+00:00") for note in notes)
    described = json.loads((out / "columns.json").read_text())
    for name, lines in ((QUESTIONNAIRE_CSV, answers), (NOTES_CSV, notes)):
        assert set(described[name]) == set(lines[0]) and all(entry["description"] for entry in described[name].values())


def test_answers_are_a_phenotype(exported):
    [tsv] = exported["bids"].glob("phenotype/*.tsv")
    names, row = table(tsv)
    assert names[0] == "participant_id" and row[0] == "sub-01" and len(names) == 1 + 2 * len(SCALES)
    assert [float(cell) for cell in row[1:]] == [*FIRST.values(), *SECOND.values()]
    described = json.loads(tsv.with_suffix(".json").read_text())
    assert set(described) == {"MeasurementToolMetadata", *names[1:]}


def test_answers_after_a_controller_belong_to_it_in_every_export(tmp_path):
    session = new_session(tmp_path, "07")
    session.journal(CONTROLLER_ANSWERS, configuration="four-brake", controller=3, values=FIRST)
    session.close()
    home = session.folder
    answers, notes = answers_and_notes([home])
    assert answers[0][:5] == ("07", "four-brake", 0, 3, FIRST)
    described = write_answers_and_notes(tmp_path, answers, notes)[QUESTIONNAIRE_CSV]
    [row] = rows(tmp_path / QUESTIONNAIRE_CSV)
    assert (row["controller"], row["block"]) == ("3", "") and described.keys() == row.keys()
    write_phenotype(tmp_path, answers)
    head = (tmp_path / "phenotype" / "tlxsmoothness.tsv").read_text().splitlines()[0]
    assert f"four-brake_controller-3_{next(iter(FIRST))}" in head.split("\t")


# ---------------------------------------------------------------------------------------------- measures, once more
# From an exported CSV and from the words of their definitions alone: csv, json, plain Python, numpy arrays and SciPy's
# filter compute here, nothing of ours.


def movement(folder, trial):
    """Ticks, numbers of the ticks of `move`, start and end of the path."""
    path = folder / trial["recording"]
    ticks = rows(path)
    about = json.loads(path.with_suffix(".json").read_text())["trial"]
    move = [i for i, tick in enumerate(ticks) if tick["phase"] == "move"]
    return ticks, move, about["start_m"], about["end_m"]


def path_error(ticks, move, start, end):
    """|d| averaged over path progress: trapezoids over the running maximum of the projection, clipped to the ends."""
    length = math.dist(start, end)
    along = [(end[0] - start[0]) / length, (end[1] - start[1]) / length]
    furthest, area, before = -math.inf, 0.0, None
    for i in move:
        x, y = float(ticks[i]["tip_x_m"]) - start[0], float(ticks[i]["tip_y_m"]) - start[1]
        distance = abs(along[0] * y - along[1] * x)
        furthest = max(furthest, min(max(along[0] * x + along[1] * y, 0.0), length))
        if before is None:
            first = furthest
        else:
            area += 0.5 * (distance + before[1]) * (furthest - before[0])
        before = furthest, distance
    return area / (furthest - first)


def mean_tip_force(ticks, move, *_):
    """Time mean of |hand force|."""
    return math.fsum(math.hypot(float(ticks[i]["hand_fx_N"]), float(ticks[i]["hand_fy_N"])) for i in move) / len(move)


def acceleration_dft_sum(ticks, move, *_):
    """Sum over f up to 100 Hz of (f / 1 Hz) sqrt(|Ax|^2 + |Ay|^2), single-sided amplitudes 2/N, mean removed.

    Acceleration: tip position under a 4th-order Butterworth low-pass of 20 Hz, forward and backward, over the whole
    recording at 1 kHz, two central differences, then the ticks of `move`. The DFT is summed term by term.
    """
    low_pass = signal.butter(4, 20.0, fs=1000.0, output="sos")
    x = signal.sosfiltfilt(
        low_pass, np.array([[float(tick["tip_x_m"]), float(tick["tip_y_m"])] for tick in ticks]), axis=0
    )
    i = np.array(move)
    a = (x[i + 2] - 2.0 * x[i] + x[i - 2]) / (2.0 * 0.001) ** 2
    a = a - a.sum(axis=0) / len(a)
    n, total = len(a), 0.0
    for k in range(1, n):
        f = k * 1000.0 / n
        if f > 100.0:
            break
        turn = np.exp(-2j * np.pi * ((k * np.arange(n)) % n) / n)
        total += f * 2.0 / n * math.sqrt(abs(turn @ a[:, 0]) ** 2 + abs(turn @ a[:, 1]) ** 2)
    return total


@pytest.mark.parametrize(
    ("column", "again", "rounding"),
    [
        ("path_error_m", path_error, 1e-12),
        ("mean_tip_force_N", mean_tip_force, 1e-13),
        ("acceleration_dft_sum", acceleration_dft_sum, 1e-11),
    ],
)
def test_every_trial_has_the_measure_that_its_ticks_give(exported, column, again, rounding):
    out = exported["csv"]
    trials = [row for row in rows(out / "trials.csv") if row["participant"] == "01"]
    assert len(trials) == 3
    for trial in trials:
        assert again(*movement(out, trial)) == pytest.approx(float(trial[column]), rel=rounding), trial["recording"]
