"""Controllers and measures in files of one's own: everywhere a shipped one is, whatever they do, and only if allowed.

Code out of a session's folder runs only after its user was asked, and whatever it does ends in one sentence.
"""

import json
import os
import pickle
import re
import shutil
import stat
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from own_files import DAMPER, FREE, MEASURE, PROTOCOL, controller_of, measures_of, own_experiment
from rows import read_rows

import phd
from app.cli import main
from core import own_consent, own_process, tick_log
from core.control import sdof
from core.control.controllers import CODED, DECISIONS, Preset, make_controller, make_preset
from core.files import InputError
from core.own_consent import allow, is_allowed
from core.path import build_path
from experiments.analysis.charts import POOLED, View, charts
from experiments.analysis.metrics import MeasureFailed
from experiments.analysis.movement import Movement
from experiments.analysis.own_measures import metrics_in, own_metrics
from experiments.export.export import export
from experiments.export.results import read_results
from experiments.own_controller import refuse_unusable
from experiments.plan import PlannedTrial
from experiments.protocol import load_protocol, protocol_from_json, protocol_to_json
from experiments.recording import recording_of
from experiments.store.blind import blinded
from experiments.store.metadata import preset_from_json
from experiments.store.own_code import unallowed_code
from experiments.store.recording import read_recording
from experiments.store.session import Participant, Session
from experiments.store.verify import verify
from experiments.study.analyze import analyze
from experiments.study.controller_check import check_controller
from experiments.study.replay import Replacement, replay
from experiments.study.study import run_study
from experiments.study.unrecorded import person_of, run_trial, switched_on, trial_of
from experiments.trial.population import load_population
from experiments.trial.trial import SimulatedTrial

ROOT = Path(__file__).resolve().parents[2]
SHIPPED = Path(sdof.__file__).read_text()
ASKED = "It is not run: nobody can be asked here"
FAILS = """

def failing(movement):
    if (movement.column("decision") == "damped").any():
        return 1 / 0
    return float("nan")


MEASURES += (Measure("failing", "Failing", "", failing),)
"""


@pytest.fixture(scope="module")
def received(tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    """A study with a controller of its own, two measures that are right and one that fails; its files are gone.

    Each of its files leaves a file, `ran`, wherever it runs.
    """
    folder = tmp_path_factory.mktemp("own")
    ran = f"\nopen({str(folder / 'ran')!r}, 'a').write(__name__)\n"
    code = {"my_damper": DAMPER + ran, "my_measure": MEASURE + FAILS + ran}
    file = own_experiment(folder, f'measure = "my_measure.py"\n{PROTOCOL}{FREE}', **code)
    protocol = load_protocol(file)
    summary = run_study(folder / "study", 1, protocol, load_population())
    for name in ("ran", "my_damper.py", "my_measure.py"):
        (folder / name).unlink()
    return SimpleNamespace(folder=folder, out=folder / "study", protocol=protocol, summary=summary)


def new_trial(preset: Preset) -> SimulatedTrial:
    paper = load_protocol()
    return trial_of(
        paper, person_of(load_population(), 1, 1), 1, PlannedTrial(1, 1, "four-brake", 2, 1, 1),
        switched_on(paper.device("four-brake"), paper), preset,
    )  # fmt: skip


def ticks(preset: Preset) -> np.ndarray:
    """A trial with this controller."""
    return run_trial(new_trial(preset)).copy()


# ------------------------------------------------------------------------------------------------------ a controller


def test_the_file_of_a_shipped_controller_decides_to_the_last_bit_as_the_shipped_one():
    own = make_preset("Mine", "mine.py", {"gap_m": 0.001}, controller_of("mine", SHIPPED))
    shipped, other = ticks(make_preset("SDOF", "sdof", {"gap_m": 0.001})), ticks(own)
    words = [np.array(preset.decisions, dtype=object)[rows[:, tick_log.DECISION].astype(int)]
             for preset, rows in ((make_preset("SDOF", "sdof", {}), shipped), (own, other))]  # fmt: skip
    assert (words[0] == words[1]).all() and any(word.startswith("sdof") for word in words[0])
    shipped[:, tick_log.DECISION] = other[:, tick_log.DECISION] = 0.0
    assert np.array_equal(shipped, other, equal_nan=True)


def test_a_study_replays_and_names_its_decisions_and_the_file_is_in_its_folder(received):
    paths = sorted(received.out.glob("sub-01/ses-01/trials/*"))
    recordings = {recording.metadata["controller"]: recording for recording in map(read_recording, paths)}
    assert "damped" in recordings[1].words["decision"] and recordings[2].words["decision"] == DECISIONS
    assert (recordings[1].text("decision") == "damped").any()
    stored = preset_from_json(json.loads(json.dumps(recordings[1].metadata["preset"])))
    assert stored == received.protocol.controllers[1] and stored.own and stored.own.text.startswith(DAMPER)
    again = protocol_from_json(json.loads(json.dumps(protocol_to_json(received.protocol))), "stored")
    assert again.controllers[1] == stored
    assert replay(recordings[1].path)["equal"], "from the folder alone"
    assert replay(recordings[2].path, Replacement(controller=1))["after"]["controller"] == "1 Damper"


def test_a_blind_sessions_recordings_name_the_same_decisions_for_every_controller(tmp_path: Path):
    protocol = load_protocol(own_experiment(tmp_path))
    session = Session(tmp_path / "data", Participant("01"), protocol, blind=True, sync=False)
    words = set()
    for planned in session.plan:
        _, writer = session.begin(planned)
        path = session.folder / "trials" / f"run-{planned.run:03d}.parquet"
        words.add(read_recording(path).words["decision"])
    session.close()
    assert len(session.plan) == 2 and words == {(*DECISIONS, *CODED)}


WILD = """
    n = 0
    while controller.values[1] == 6.0:
        n += 1
    if controller.values[1] == 0.0:
        tick.brakes.current_max[0], tick.brakes.present[1] = 100.0, 1.0
        tick.current[0], tick.current[1], tick.current[2], tick.current[3] = 50.0, math.nan, math.inf, -1.0
        return DAMPED
    if controller.values[1] == 1.0:
        tick.current[int(controller.values[1]) + 3] = 1e9
    if controller.values[1] == 2.0:
        tick.current[int(controller.values[1]) - 7] = 1e9
    if controller.values[1] == 3.0:
        raise ValueError("this cannot be")
    if controller.values[1] == 4.0:
        return DAMPED + 1
    if controller.values[1] == 5.0:
        actuate(tick, 7, 1.0)
"""
#: A value of its parameter -> the refusal.
RAISED, UNDECLARED = "raised an error or used an index beyond", "returned a decision that its ALGORITHM does not"
REFUSED = {1: RAISED, 2: RAISED, 3: RAISED, 4: UNDECLARED, 5: RAISED}


def test_whatever_the_file_does_brakes_get_what_they_may_have_or_the_trial_ends_without_current(tmp_path, monkeypatch):
    head, body = DAMPER.replace("from core.k", "import math\n\nfrom core.k", 1).split('speed."""\n')
    text = f'{head}speed."""{WILD}{body}'
    own = controller_of("wild", text)
    found = check_controller(own, {"damping_N_s_m": 0.0})
    assert not found["failed"] and found["trials"] == 8
    for which, reason in REFUSED.items():
        preset = make_preset("Wild", "wild.py", {"damping_N_s_m": which}, own)
        with pytest.raises(InputError, match=f"wild.py: the controller's file {reason}"):
            ticks(preset)
    trial = new_trial(preset)
    rows = np.empty((9000, tick_log.WIDTH))
    rows = rows[: trial.run(rows)]
    assert trial.finished and trial.outcome()["status"] == "aborted" and RAISED in trial.outcome()["reason"]
    assert not rows[:, tick_log.CURRENT : tick_log.CURRENT + 4].any() and np.isfinite(rows[:, tick_log.TIP_X]).all()

    monkeypatch.setattr(own_process, "LONGEST_S", 1.0)
    endless = PROTOCOL.replace("my_damper", "wild").replace("500.0", "6.0")
    protocol = load_protocol(own_experiment(tmp_path, endless, wild=text))
    with pytest.raises(InputError, match="wild.py: its first tick: took longer than 1 s and was ended"):
        Session(tmp_path / "data", Participant("01"), protocol)
    assert not (tmp_path / "data").exists()


@pytest.mark.parametrize("text, wanted", [
    ("x = (", "damper.py: cannot be run: line 1: SyntaxError"),
    (DAMPER.replace("@kernel\n", ""), "write @kernel above it"),
    (DAMPER.replace("return DAMPED", "return tick.nothing"), "line 30: Unknown attribute 'nothing' of type Tick$"),
    (DAMPER.replace("damping * abs", "dampin * abs"), "^damper.py: does not compile: line 29: .*'dampin' is not def"),
    (DAMPER.replace("best, damping *", "damping *"), "line 29: a call of .tick, i, force.: missing a required arg"),
    (DAMPER.replace("    best, most", "    tick.g[0, 0] = 1.0\n    best, most", 1), "compile: .*readonly array"),
    (DAMPER.replace("(GAP_M, DAMPING)", "GAP_M"), "must be a tuple of Parameter"),
    (DAMPER.replace("200.0, (10.0, 2000.0)", '"200", (10.0, 2000.0)'), "must be numbers"),
    (DAMPER.replace('("damped",)', '("damped")'), 'decisions must be a tuple of texts: ."damped",.'),
    (f"{DAMPER}\nimport os; os.chdir('/')", "changed the current folder"),
    (f"{DAMPER}\nimport os; os.close(2)", "closed a file"),
    (f"{DAMPER}\nimport os; os._exit(0)", "ended its process"),
    (f"{DAMPER}\nimport sys; sys.exit(0)", "SystemExit"),
    (f"{DAMPER}\ndef f(n):\n    return g(n)\n\n\ndef g(n):\n    return f(n)\n", "f calls itself"),
])  # fmt: skip
def test_a_file_that_cannot_run_is_refused_in_a_sentence_whatever_it_does(text: str, wanted: str):
    here = os.getcwd()
    with pytest.raises(InputError, match=wanted) as refused:
        make_controller(make_preset("Damper", "damper.py", {}, controller_of("damper", text)), 30.0)
    assert "\n" not in str(refused.value) and os.getcwd() == here


# --------------------------------------------------------------------------------------------------------- a measure


def test_it_has_its_column_its_chart_its_lines_in_the_report_and_its_unit_in_a_frame(received):
    trials = phd.load_trials(received.out)
    late = trials["late_error_mm"]
    assert trials.attrs["units"]["late_error_mm"] == "mm" and trials["hard_push_share"].between(0.0, 1.0).all()
    assert ((late > 0.0) & (late <= 1e3 * trials["peak_error_m"])).all()
    report = received.out / "report"
    assert "| Late error (mm) |" in (report / "report.md").read_text()
    assert all("late_error_mm" in (report / f"{name}.csv").read_text() for name in ("statistics", "participant_means"))
    results = read_results(received.out)
    assert [metric.name for metric in results.own] == ["late_error_mm", "hard_push_share", "failing"]
    shown = charts(POOLED, results.trials, View(results.configurations, results.labels, measures=results.own))
    assert sorted(point.y for point in shown[0].points) == sorted(late) and not shown[2].points
    boxes = phd.boxes(trials, "late_error_mm")
    assert boxes.loc[(1, "three-brake"), "median"] == trials.query("controller == 1")["late_error_mm"].median()


def test_where_it_fails_the_trial_stays_its_cell_is_empty_and_it_is_counted_and_said(received):
    rows = read_rows(received.out / "trials.csv")
    assert len(rows) == 2 and all(row.status == "done" and "failing" not in row.own for row in rows)
    assert "failing" not in (received.out / "trials.csv").read_text()
    said = received.summary["warnings"]
    assert "Failing has no value in 2 of 2 trials that count." in said
    line = MEASURE.count("\n") + 5
    assert f"my_measure.py: failing: line {line}: ZeroDivisionError: division by zero, in 1 trial." in said
    assert "my_measure.py: failing: answered nan, which is no finite number, in 1 trial." in said
    assert "Failing has no value in 2 of 2 trials" in (received.out / "report/report.md").read_text()


def test_the_recordings_alone_give_the_same_table_and_verify_tells_a_changed_cell(received, tmp_path):
    found = analyze(received.out, tmp_path / "again")
    before, again = (read_rows(folder / "trials.csv") for folder in (received.out, tmp_path / "again"))
    assert [row.own for row in again] == [row.own for row in before]
    assert any("ZeroDivisionError" in warning for warning in found["warnings"]) and found["changed"] == []
    assert verify(received.out)["faults"] == []
    table = shutil.copytree(received.out, tmp_path / "kept") / "sub-01/ses-01/trials.csv"
    table.write_text(table.read_text().replace(repr(before[0].own["late_error_mm"]), "7.25"))
    assert any("was edited" in fault["fault"] for fault in verify(tmp_path / "kept")["faults"])
    measures = replay(received.out / before[0].recording)["metrics"]
    assert measures["late_error_mm"]["change"] == 0.0


def test_an_export_describes_it_and_a_blind_table_hides_it(received, tmp_path):
    export(received.out, {"csv": tmp_path / "csv", "bids": tmp_path / "bids"})
    columns = json.loads((tmp_path / "csv/columns.json").read_text())["trials.csv"]
    wanted = "largest distance from the path in its last third"
    assert columns["late_error_mm"] == {"unit": "mm", "description": wanted}
    assert json.loads((tmp_path / "bids/scans.json").read_text())["late_error_mm"]["Units"] == "mm"
    header, first = (tmp_path / "bids/sub-01/ses-01/sub-01_ses-01_scans.tsv").read_text().splitlines()[:2]
    cells = dict(zip(header.split("\t"), first.split("\t"), strict=True))
    row = read_rows(received.out / "trials.csv")[0]
    assert float(cells["late_error_mm"]) == row.own["late_error_mm"] and cells["failing"] == "n/a"
    assert blinded(type(row)(**{**vars(row), "controller": "K1"})).own == {}


@pytest.mark.parametrize("text, wanted", [
    ("x = (", "my_measure.py: cannot be run: line 1: SyntaxError"),
    ("import sys; sys.exit(3)", "line 1: SystemExit: 3"),
    ("MEASURES = 3", "must have MEASURES"),
    (MEASURE.replace('"late_error_mm"', '"late error"'), "letters .a to z., digits and _, not 'late error'"),
    (MEASURE.replace('"late_error_mm"', '"path_error_m"'), "path_error_m is a column that tables have already"),
    (MEASURE.replace('"hard_push_share"', '"late_error_mm"'), "two measures have the same name"),
    (MEASURE.replace('above 5 N")', 'above 5 N", better="least")'), "better must be one of lower, higher"),
])  # fmt: skip
def test_a_file_that_declares_no_measures_is_refused_in_a_sentence(text: str, wanted: str):
    with pytest.raises(InputError, match=wanted) as refused:
        metrics_in(measures_of("my_measure", text))
    assert "\n" not in str(refused.value)


def answer_of(body: str) -> float | None:
    """What a measure answers whose function has this body. MeasureFailed."""
    text = f"{MEASURE}\nimport os, sys, signal\n\ndef attack(m):\n    {body}\n"
    (metric,) = metrics_in(measures_of("odd", f"{text}\nMEASURES = (Measure('a', 'A', '', attack),)\n"))
    recording = recording_of(np.zeros((50, tick_log.WIDTH)), "")
    recording.columns["phase"][:] = recording.words["phase"].index("move")
    path = build_path(load_protocol().paths[1], "path")
    return metric.of(Movement(recording, path))


@pytest.mark.parametrize("body, said", [
    ("return 'much'", "answered no number .str 'much'."),
    ("return np.zeros(3)", "answered no number .ndarray"),
    ("return 10**400", "OverflowError|no finite number"),
    ("return m.column('nothing')", "has no column 'nothing'; it has t_s"),
    ("raise SystemExit(3)", "odd.py: a: line N: SystemExit: 3"),
    ("return attack(m)", "odd.py: a: line N: RecursionError: maximum recursion depth exceeded"),
    ("sys.setrecursionlimit(10**9); f = lambda: sorted([0], key=lambda _: f()); f()", "crashed its process"),
    ("os.kill(os.getpid(), signal.SIGKILL)", "odd.py: a: ended its process .exit status -9"),
    ("os.kill(os.getppid(), 0); os.chdir('/'); return 1.0", "odd.py: a: changed the current folder"),
    ("os.close(1); return 1.0", "odd.py: a: closed a file"),
    ("os.closerange(0, 500); return 1.0", "odd.py: a: ended its process"),
    ("while True: pass", "odd.py: a: took longer than 1 s and was ended"),
    ("print('{\"result\": 7.0}'); return np.float32(0.5)", ""),
])  # fmt: skip
def test_whatever_a_measure_does_is_one_sentence_and_the_next_one_is_measured(body, said, monkeypatch, capfd):
    if "while" in body:
        monkeypatch.setattr(own_process, "LONGEST_S", 1.0)
    here, ours = os.getcwd(), os.fstat(1)
    if said:
        with pytest.raises(MeasureFailed) as failed:
            answer_of(body)
        line = MEASURE.count("\n") + 5
        assert re.search(said.replace("line N", f"line {line}"), str(failed.value)) and "\n" not in str(failed.value)
    else:
        answer = answer_of(body)
        assert answer == 0.5 and type(answer) is float, "after all of the others"
    assert os.getcwd() == here and os.path.samestat(os.fstat(1), ours)
    capfd.readouterr()


def test_two_protocols_may_have_files_of_one_name_with_other_texts(tmp_path: Path):
    units = []
    for unit in ("mm", "cm"):
        (tmp_path / unit).mkdir()
        text = MEASURE.replace('"mm"', f'"{unit}"')
        file = own_experiment(tmp_path / unit, f'measure = "my_measure.py"\n{PROTOCOL}', my_measure=text)
        units.append(own_metrics(load_protocol(file))[0].unit)
    assert units == ["mm", "cm"]


# --------------------------------------------------------------------------------------------------- who may run them


@pytest.fixture
def elsewhere(received, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The study, where its user has allowed nothing."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.setenv(own_consent.VARIABLE, "")
    (received.folder / "ran").unlink(missing_ok=True)
    return shutil.copytree(received.out, tmp_path / "study")


def test_nobody_was_asked_so_nothing_runs_and_once_allowed_another_process_decides_the_same(
    elsewhere, received, tmp_path
):
    """In a process that has never run them."""
    verbs = (
        ["verify", elsewhere], ["export", elsewhere, "--csv", tmp_path / "csv"],
        ["analyze", elsewhere, "--out", tmp_path / "again"],
        ["replay", elsewhere / "sub-01/ses-01/trials/run-001.parquet", "--json"],
        ["study", "--resume", "--out", elsewhere],
    )  # fmt: skip
    protocol, ran = received.protocol, received.folder / "ran"
    device, planned = switched_on(protocol.devices[0], protocol), PlannedTrial(1, 1, "three-brake", 1, 1, 1)
    preset = protocol.controllers[1]
    trial = trial_of(protocol, person_of(load_population(), 1, 1), 1, planned, device, preset)
    (tmp_path / "trial").write_bytes(pickle.dumps(trial))
    script = f"""
import os, pickle, sys
sys.path.insert(1, {str(ROOT / "tests/support")!r})
import conclusions
from app.cli import main
from core.own_consent import allow_everything
from experiments.study.unrecorded import run_trial
with conclusions.left_out():
    for verb in {[[str(word) for word in verb] for verb in verbs]}:
        print("exit code", main(verb), file=sys.stderr)
print("ran:", os.path.exists({str(ran)!r}))
allow_everything()
run_trial(pickle.load(open({str(tmp_path / "trial")!r}, "rb"))).tofile({str(tmp_path / "ticks")!r})
"""
    about = {"cwd": ROOT, "text": True, "stdin": subprocess.DEVNULL, "capture_output": True, "check": False}
    found = subprocess.run([sys.executable, "-c", script], **about)
    said = found.stderr.split("exit code ")
    assert [part[0] for part in said[1:5]] == ["0", "0", "0", "2"], found.stderr
    assert ASKED in said[2] and "recorded with the session, in 2 trials" in found.stdout, found
    assert said[3].strip().splitlines()[-1].startswith("phd: my_damper.py (SHA-2")
    before, again = (read_rows(folder / "trials.csv") for folder in (elsewhere, tmp_path / "again"))
    assert [row.own for row in again] == [row.own for row in before] and before[0].own
    assert "ran: False" in found.stdout and not (tmp_path / "config" / own_consent.FILE).exists()
    allow(preset.own.text)
    assert (tmp_path / "ticks").read_bytes() == run_trial(trial).tobytes() and ran.exists()


def test_yes_is_remembered_by_the_hash_for_the_user_alone_and_no_is_no(elsewhere, tmp_path, monkeypatch, capsys):
    pty = pytest.importorskip("pty")  # Windows has none
    ours, theirs = pty.openpty()
    with open(theirs, "r+b", buffering=0) as raw, open(raw.fileno(), closefd=False) as terminal:
        monkeypatch.setattr(sys, "stdin", terminal)
        monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
        codes = []
        for answer in (b"n\n", b"y\n"):
            os.write(ours, answer)
            codes.append((main(["study", "--resume", "--out", str(elsewhere)]), len(unallowed_code(elsewhere))))
    os.close(ours)
    assert codes == [(2, 2), (0, 0)] and capsys.readouterr().err.count("Run it? [y/N]") == 2
    kept = tmp_path / "config" / own_consent.FILE
    assert stat.S_IMODE(kept.stat().st_mode) == 0o600 and len(kept.read_text().split()) == 2
    monkeypatch.setenv(own_consent.VARIABLE, "")
    assert unallowed_code(elsewhere) == {}
    kept.chmod(0o622)
    assert len(unallowed_code(elsewhere)) == 2, "others could have written it"


def test_a_session_that_is_resumed_needs_the_answer_too_and_an_option_gives_it(elsewhere, received, tmp_path, capsys):
    with pytest.raises(InputError, match="my_damper.py .* was not allowed to run"):
        Session.resume(elsewhere, "01")
    assert not (received.folder / "ran").exists() and len(unallowed_code(elsewhere)) == 2
    assert main(["analyze", str(elsewhere), "--out", str(tmp_path / "again"), "--run-own-code", "--json"]) == 0
    assert "recorded with the session" not in capsys.readouterr().out and unallowed_code(elsewhere) == {}


def test_what_a_user_starts_is_trusted_and_shipped_code_is_ours(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.setenv(own_consent.VARIABLE, "")
    protocol = load_protocol(own_experiment(tmp_path, f'measure = "my_measure.py"\n{PROTOCOL}{FREE}'))
    assert all(is_allowed(own.text) for own in protocol.code.values()) and not is_allowed("else")
    monkeypatch.setenv(own_consent.VARIABLE, "")
    assert all(is_allowed(own.text) for own in protocol.code.values()), "remembered"
    (tmp_path / "config" / own_consent.FILE).unlink()
    Session(tmp_path / "ours", Participant("01"), load_protocol("displays")).close()
    monkeypatch.setenv(own_consent.VARIABLE, "")
    assert unallowed_code(tmp_path / "ours") == {}


def test_a_folder_cannot_say_that_its_code_declares_something_else():
    allow(DAMPER)
    own = controller_of("my_damper", DAMPER)
    other = own._replace(declared=own.declared.replace("damped", "harmless"))
    with pytest.raises(InputError, match="declares something else than what is stored of it"):
        refuse_unusable([make_preset("Mine", "my_damper.py", {}, other)])
    for damaged in ("", "[]", '{"algorithm": 3}', '{"algorithm": [[[1, 2]], []]}', "[" * 100_000):
        with pytest.raises(InputError, match="damaged"):
            make_preset("Mine", "my_damper.py", {}, own._replace(declared=damaged))
