"""Code out of a session's folder runs only after its user was asked, and whatever it does ends in one sentence."""

import os
import pty
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from own_files import DAMPER, FREE, MEASURE, PROTOCOL, controller_of, measures_of, own_experiment
from rows import read_rows

from app.cli import main
from core import own_consent, own_process, tick_log
from core.control.controllers import make_preset
from core.files import InputError
from core.own_consent import allow, is_allowed
from core.path import build_path
from experiments.analysis.metrics import MeasureFailed
from experiments.analysis.movement import Movement
from experiments.analysis.own_measures import metrics_in
from experiments.own_controller import refuse_unusable
from experiments.protocol import load_protocol
from experiments.recording import recording_of
from experiments.store.own_code import unallowed_code
from experiments.store.session import Participant, Session
from experiments.study.study import run_study
from experiments.trial.population import load_population

ROOT = Path(__file__).resolve().parents[2]
ASKED = "It is not run: nobody can be asked here"


@pytest.fixture(scope="module")
def received(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study with a controller and measures of its own, each of which leaves a file wherever it runs."""
    folder = tmp_path_factory.mktemp("stranger")
    ran = f"\nopen({str(folder / 'ran')!r}, 'a').write(__name__)\n"
    file = own_experiment(
        folder, f'measure = "my_measure.py"\n{PROTOCOL}{FREE}', my_damper=DAMPER + ran, my_measure=MEASURE + ran
    )
    run_study(folder / "study", 1, load_protocol(file), load_population())
    (folder / "ran").unlink()
    return folder


@pytest.fixture
def elsewhere(received: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The study, where its user has allowed nothing."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.setenv(own_consent.VARIABLE, "")
    (received / "ran").unlink(missing_ok=True)
    shutil.copytree(received / "study", tmp_path / "study")
    return tmp_path / "study"


#: Figures and error bars, which take longest, are left out.
BRIEFLY = f"import sys; sys.path.insert(1, {str(ROOT / 'tests/support')!r}); import conclusions\n"


def python(script: str) -> subprocess.CompletedProcess:
    """Run Python code, without a terminal."""
    about = {"cwd": ROOT, "text": True, "stdin": subprocess.DEVNULL, "capture_output": True, "check": False}
    script = f"{BRIEFLY}with conclusions.left_out():\n" + "".join(f"    {line}\n" for line in script.splitlines())
    return subprocess.run([sys.executable, "-c", script], **about)


def asked(answers: str, folder: Path, verb: list[str]) -> subprocess.CompletedProcess:
    """Run a verb as often as there are answers to its question on a terminal; it prints exit codes, and whether code
    out of the folder has run by then.
    """
    once = f"(main({verb}), os.path.exists({str(folder / 'ran')!r}))"
    run = f"from app.cli import main; import os; print([{once} for _ in range({len(answers.split())})])"
    command, about = [sys.executable, "-c", run], {"cwd": ROOT, "text": True}
    ours, theirs = pty.openpty()
    try:
        with subprocess.Popen(command, stdin=theirs, stdout=subprocess.PIPE, stderr=theirs, **about) as process:
            os.write(ours, answers.encode())
            os.close(theirs)
            out = process.stdout.read()
            said = os.read(ours, 100_000).decode()
        return subprocess.CompletedProcess(command, process.returncode, out, said)
    finally:
        os.close(ours)


def test_nobody_was_asked_so_nothing_runs_and_tables_keep_what_was_recorded(elsewhere, received, tmp_path):
    session = elsewhere / "sub-01/ses-01"
    verbs = (
        ["verify", elsewhere], ["export", elsewhere, "--csv", tmp_path / "csv"],
        ["analyze", elsewhere, "--out", tmp_path / "again"], ["replay", session / "trials/run-001.parquet", "--json"],
        ["study", "--resume", "--out", elsewhere],
    )  # fmt: skip
    one_after_another = f"""
from app.cli import main
for verb in {[[str(word) for word in verb] for verb in verbs]}:
    print("exit code", main(verb), file=sys.stderr)
"""
    found = python(one_after_another)
    said = found.stderr.split("exit code ")
    assert [part[0] for part in said[1:5]] == ["0", "0", "0", "2"], found.stderr
    assert ASKED in said[2] and "recorded with the session, in 2 trials" in found.stdout, found
    assert said[3].strip().splitlines()[-1].startswith("phd: my_damper.py (SHA-2")
    before, again = (read_rows(folder / "trials.csv") for folder in (elsewhere, tmp_path / "again"))
    assert [row.own for row in again] == [row.own for row in before] and before[0].own
    assert not (received / "ran").exists(), found
    assert not (tmp_path / "config" / own_consent.FILE).exists()


def test_a_session_that_is_resumed_needs_the_answer_too(elsewhere, received):
    with pytest.raises(InputError, match="my_damper.py .* was not allowed to run"):
        Session.resume(elsewhere, "01")
    assert not (received / "ran").exists()


def test_yes_is_remembered_by_the_hash_for_the_user_alone_and_no_is_no(elsewhere, received, tmp_path):
    recording = elsewhere / "sub-01/ses-01/trials/run-001.parquet"
    found = asked("n\ny\n", received, ["replay", str(recording), "--json"])
    assert found.stdout.endswith("[(2, False), (0, True)]\n") and "Run it? [y/N]" in found.stderr
    kept = tmp_path / "config" / own_consent.FILE
    assert stat.S_IMODE(kept.stat().st_mode) == 0o600 and len(kept.read_text().split()) == 2
    assert unallowed_code(elsewhere) == {}
    kept.chmod(0o622)
    assert len(unallowed_code(elsewhere)) == 2, "others could have written it"


def test_an_option_allows_it_where_nobody_can_be_asked(elsewhere, tmp_path, capsys):
    assert len(unallowed_code(elsewhere)) == 2
    assert main(["analyze", str(elsewhere), "--out", str(tmp_path / "again"), "--run-own-code", "--json"]) == 0
    assert "recorded with the session" not in capsys.readouterr().out and unallowed_code(elsewhere) == {}


def test_what_a_user_starts_is_trusted_and_shipped_code_is_ours(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.setenv(own_consent.VARIABLE, "")
    file = own_experiment(tmp_path, f'measure = "my_measure.py"\n{PROTOCOL}{FREE}')
    protocol = load_protocol(file)
    assert all(is_allowed(own.text) for own in protocol.code.values()) and not is_allowed("else")
    monkeypatch.setenv(own_consent.VARIABLE, "")
    assert all(is_allowed(own.text) for own in protocol.code.values()), "remembered"
    (tmp_path / "config" / own_consent.FILE).unlink()
    Session(tmp_path / "ours", Participant("01"), load_protocol("displays")).close()
    monkeypatch.setenv(own_consent.VARIABLE, "")
    assert unallowed_code(tmp_path / "ours") == {}


def answer_of(body: str, before: str = "") -> float | None:
    """What a measure answers whose function has this body. MeasureFailed."""
    text = f"{MEASURE}\nimport os, sys, signal\n{before}\ndef attack(m):\n    {body}\n"
    (metric,) = metrics_in(measures_of("odd", f"{text}\nMEASURES = (Measure('a', 'A', '', attack),)\n"))
    recording = recording_of(np.zeros((50, tick_log.WIDTH)), "")
    recording.columns["phase"][:] = recording.words["phase"].index("move")
    path = build_path(load_protocol().paths[1], "path")
    return metric.of(Movement(recording, path))


@pytest.mark.parametrize("body, said", [
    ("raise SystemExit(3)", "odd.py: a: line N: SystemExit: 3"),
    ("raise KeyboardInterrupt", "odd.py: a: line N: KeyboardInterrupt"),
    ("return attack(m)", "odd.py: a: line N: RecursionError: maximum recursion depth exceeded"),
    ("sys.setrecursionlimit(10**9); f = lambda: sorted([0], key=lambda _: f()); f()", "crashed its process"),
    ("os.kill(os.getpid(), signal.SIGKILL)", "odd.py: a: ended its process (exit status -9)"),
    ("os.kill(os.getppid(), 0); os.chdir('/'); return 1.0", "odd.py: a: changed the current folder"),
    ("os.close(1); return 1.0", "odd.py: a: closed a file"),
    ("os.closerange(0, 500); return 1.0", "odd.py: a: ended its process"),
    ("while True: pass", "odd.py: a: took longer than 1 s and was ended"),
    ("print('{\"result\": 7.0}'); return 2.0", ""),
])  # fmt: skip
def test_whatever_a_measure_does_is_one_sentence_and_the_next_one_is_measured(body, said, monkeypatch, capfd):
    if "while" in body:
        monkeypatch.setattr(own_process, "LONGEST_S", 1.0)
    here, ours = os.getcwd(), os.fstat(1)
    if said:
        with pytest.raises(MeasureFailed) as failed:
            answer_of(body)
        line = MEASURE.count("\n") + 5
        assert said.replace("line N", f"line {line}") in str(failed.value) and "\n" not in str(failed.value)
    else:
        assert answer_of(body) == 2.0, "after all of the others"
    assert os.getcwd() == here and os.path.samestat(os.fstat(1), ours)
    capfd.readouterr()


@pytest.mark.parametrize("code, said", [
    ("import os; os.chdir('/')", "changed the current folder"),
    ("import os; os.close(2)", "closed a file"),
    ("import os; os._exit(0)", "ended its process"),
    ("raise KeyboardInterrupt", "KeyboardInterrupt"),
    ("import sys; sys.exit(0)", "SystemExit"),
    ("def f(n):\n    return g(n)\n\n\ndef g(n):\n    return f(n)\n", "f calls itself"),
])  # fmt: skip
def test_whatever_a_controller_does_is_one_sentence(code: str, said: str):
    here = os.getcwd()
    with pytest.raises(InputError, match=said) as refused:
        controller_of("odd", f"{DAMPER}\n{code}\n")
    assert "\n" not in str(refused.value) and os.getcwd() == here


def test_a_controller_whose_first_tick_does_not_end_is_refused_before_any_folder_is_made(tmp_path, monkeypatch):
    loop = "n = 0\n    while controller.values[1] > 100.0:\n        n += 1\n    "
    text = DAMPER.replace("damping, seen =", f"{loop}damping, seen =")
    own = controller_of("my_damper", text)
    refuse_unusable([make_preset("Mine", "my_damper.py", {"damping_N_s_m": 50.0}, own)])  # it is compiled now
    monkeypatch.setattr(own_process, "LONGEST_S", 1.0)
    endless = load_protocol(own_experiment(tmp_path, my_damper=text))
    with pytest.raises(InputError, match="my_damper.py: its first tick: took longer than 1 s and was ended"):
        Session(tmp_path / "data", Participant("01"), endless)
    assert not (tmp_path / "data").exists()


def test_a_folder_cannot_say_that_its_code_declares_something_else(tmp_path):
    allow(DAMPER)
    own = controller_of("my_damper", DAMPER)
    other = own._replace(declared=own.declared.replace("damped", "harmless"))
    with pytest.raises(InputError, match="declares something else than what is stored of it"):
        refuse_unusable([make_preset("Mine", "my_damper.py", {}, other)])
    for damaged in ("", "[]", '{"algorithm": 3}', '{"algorithm": [[[1, 2]], []]}', "[" * 100_000):
        with pytest.raises(InputError, match="damaged"):
            make_preset("Mine", "my_damper.py", {}, own._replace(declared=damaged))
