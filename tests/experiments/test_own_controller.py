"""A controller in a file of its own, beside a protocol: it decides as a shipped one does, in every process."""

import json
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from own_files import DAMPER, controller_of, own_experiment

from core import tick_log
from core.control import sdof
from core.control.controllers import CODED, DECISIONS, Preset, make_controller, make_preset
from core.files import InputError
from experiments.plan import PlannedTrial
from experiments.protocol import load_protocol, protocol_from_json, protocol_to_json
from experiments.store.metadata import preset_from_json
from experiments.store.recording import read_recording
from experiments.store.session import Participant, Session
from experiments.study.controller_check import check_controller
from experiments.study.replay import Replacement, replay
from experiments.study.study import run_study
from experiments.study.unrecorded import person_of, run_trial, switched_on, trial_of
from experiments.trial.population import load_population
from experiments.trial.trial import SimulatedTrial

ROOT = Path(__file__).resolve().parents[2]
SHIPPED = Path(sdof.__file__).read_text()


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return own_experiment(tmp_path)


def new_trial(preset: Preset) -> SimulatedTrial:
    paper = load_protocol()
    return trial_of(
        paper, person_of(load_population(), 1, 1), 1, PlannedTrial(1, 1, "four-brake", 2, 1, 1),
        switched_on(paper.device("four-brake"), paper), preset,
    )  # fmt: skip


def ticks(preset: Preset) -> np.ndarray:
    """A trial with this controller."""
    return run_trial(new_trial(preset)).copy()


def test_the_file_of_a_shipped_controller_decides_to_the_last_bit_as_the_shipped_one():
    own = make_preset("Mine", "mine.py", {"gap_m": 0.001}, controller_of("mine", SHIPPED))
    shipped, other = ticks(make_preset("SDOF", "sdof", {"gap_m": 0.001})), ticks(own)
    words = [np.array(preset.decisions, dtype=object)[rows[:, tick_log.DECISION].astype(int)]
             for preset, rows in ((make_preset("SDOF", "sdof", {}), shipped), (own, other))]  # fmt: skip
    assert (words[0] == words[1]).all() and any(word.startswith("sdof") for word in words[0])
    shipped[:, tick_log.DECISION] = other[:, tick_log.DECISION] = 0.0
    assert np.array_equal(shipped, other, equal_nan=True)


def test_a_study_replays_and_names_its_decisions_and_the_file_is_in_its_folder(file: Path, tmp_path: Path):
    out = tmp_path / "study"
    protocol = load_protocol(file)
    run_study(out, 1, protocol, load_population())
    recordings = {r.metadata["controller"]: r for r in map(read_recording, sorted(out.glob("sub-01/ses-01/trials/*")))}
    assert "damped" in recordings[1].words["decision"] and recordings[2].words["decision"] == DECISIONS
    assert (recordings[1].text("decision") == "damped").any()
    stored = preset_from_json(json.loads(json.dumps(recordings[1].metadata["preset"])))
    assert stored == protocol.controllers[1] and stored.own and stored.own.text == DAMPER
    (file.parent / "my_damper.py").unlink()
    assert replay(recordings[1].path)["equal"], "from the folder alone"
    assert replay(recordings[2].path, Replacement(controller=1))["after"]["controller"] == "1 Damper"


def test_a_blind_sessions_recordings_name_the_same_decisions_for_every_controller(file: Path, tmp_path: Path):
    session = Session(tmp_path / "data", Participant("01"), load_protocol(file), blind=True, sync=False)
    words = set()
    for planned in session.plan:
        _, writer = session.begin(planned)
        path = session.folder / "trials" / f"run-{planned.run:03d}.parquet"
        words.add(read_recording(path).words["decision"])
    session.close()
    assert len(session.plan) == 2 and words == {(*DECISIONS, *CODED)}


def test_another_process_finds_the_controller_at_its_own_address(file: Path, tmp_path: Path):
    protocol = load_protocol(file)
    preset = protocol.controllers[1]
    assert pickle.loads(pickle.dumps(make_controller(preset, 30.0))).address == 0
    assert protocol_from_json(json.loads(json.dumps(protocol_to_json(protocol))), "stored").controllers[1] == preset
    person, device = person_of(load_population(), 1, 1), switched_on(protocol.devices[0], protocol)
    trial = trial_of(protocol, person, 1, PlannedTrial(1, 1, "three-brake", 1, 1, 1), device, preset)
    (tmp_path / "trial").write_bytes(pickle.dumps(trial))
    code = (
        "import pickle, sys; from experiments.study.unrecorded import run_trial; "
        "sys.stdout.buffer.write(run_trial(pickle.load(open(sys.argv[1], 'rb'))).tobytes())"
    )
    run = [sys.executable, "-c", code, str(tmp_path / "trial")]
    there = subprocess.run(run, cwd=ROOT, check=True, capture_output=True).stdout
    assert there == run_trial(trial).tobytes()


WILD = """
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


def test_whatever_the_file_does_brakes_get_what_they_may_have_or_the_trial_ends_without_current():
    head, body = DAMPER.replace("from core.k", "import math\n\nfrom core.k", 1).split('speed."""\n')
    own = controller_of("wild", f'{head}speed."""{WILD}{body}')
    found = check_controller(own, {"damping_N_s_m": 0.0})
    assert not found["failed"] and found["trials"] == 8
    for which in range(1, 6):
        preset = make_preset("Wild", "wild.py", {"damping_N_s_m": which}, own)
        with pytest.raises(InputError, match="wild.py: the file of the controller failed"):
            ticks(preset)
    trial = new_trial(preset)
    rows = np.empty((9000, tick_log.WIDTH))
    rows = rows[: trial.run(rows)]
    assert trial.finished and trial.outcome()["status"] == "aborted" and "failed" in trial.outcome()["reason"]
    assert not rows[:, tick_log.CURRENT : tick_log.CURRENT + 4].any() and np.isfinite(rows[:, tick_log.TIP_X]).all()


@pytest.mark.parametrize("text, wanted", [
    ("x = (", "damper.py: cannot be run: line 1: SyntaxError"),
    ("1 / 0", "line 1: ZeroDivisionError"),
    ("x = 1", "must have ALGORITHM"),
    (DAMPER.replace("@kernel\n", ""), "write @kernel above it"),
    (DAMPER.replace("return DAMPED", "return tick.nothing"), "line 30: Unknown attribute 'nothing' of type Tick$"),
    (DAMPER.replace("damping * abs", "dampin * abs"), "^damper.py: does not compile: line 29: .*'dampin' is not def"),
    (DAMPER.replace("best, damping *", "damping *"), "line 29: a call of .tick, i, force.: missing a required arg"),
    (DAMPER.replace("    return DAMPED", "    import math\n    return DAMPED"), "line 30: .*IMPORT_NAME"),
    (DAMPER.replace("    best, most", "    tick.g[0, 0] = 1.0\n    best, most", 1), "compile: .*readonly array"),
    (DAMPER.replace("(GAP_M, DAMPING)", "GAP_M"), "must be a tuple of Parameter"),
    (DAMPER.replace("(GAP_M, DAMPING)", "(DAMPING, DAMPING)"), "each of another name"),
    (DAMPER.replace('"damping_N_s_m"', '"dämpfung"'), "letters .a to z., digits and _, not 'dämpfung'"),
    (DAMPER.replace("200.0, (10.0, 2000.0)", '"200", (10.0, 2000.0)'), "must be numbers"),
    (DAMPER.replace('("damped",)', '("damped")'), 'decisions must be a tuple of texts: ."damped",.'),
])  # fmt: skip
def test_a_file_that_cannot_run_is_refused_in_a_sentence(text: str, wanted: str):
    with pytest.raises(InputError, match=wanted) as refused:
        make_controller(make_preset("Damper", "damper.py", {}, controller_of("damper", text)), 30.0)
    assert "\n" not in str(refused.value)
