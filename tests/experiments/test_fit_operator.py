"""`phd fit-operator`: known people come back from what a bench would record of them, with intervals that hold."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from disks import flip_a_bit
from people import bench_trials
from protocols import PAPER
from refusals import refusal
from scipy import signal
from sessions import closed_session, crash_in_trial, of, session_of

from app.cli import main
from core.files import InputError
from core.path import Segment
from core.tick_log import MOVE, PHASES
from experiments.operator_fit.arm import half_width
from experiments.operator_fit.fit import RESTS_ON, Estimate, Fitted, fit_person, population_text, spread_of
from experiments.operator_fit.motions import LEAST_TRIALS, mean, motion_of, read_motions
from experiments.operator_fit.unrest import PIECE, covariance, resonance
from experiments.protocol import SHIPPED_FOLDER
from experiments.recording.reader import read_recording
from experiments.recording.schema import Recording
from experiments.trial.operator import Person, new_operator
from experiments.trial.population import load_population, population_of

AVERAGE = load_population()
PEOPLE = [("average", 60), ("from-device", 62)]  # neither of them was looked at when allowances were set


@pytest.fixture(scope="module")
def fits() -> list[tuple[Person, Fitted]]:
    """Each person, and what is found of it."""
    found = []
    for name, seed in PEOPLE:
        like = load_population(name)
        person = like.draw(np.random.default_rng(seed))
        found.append((person, fit_person(str(seed), bench_trials(person, seed, rounds=2), like)))
    return found


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """A session of nine trials."""
    folder = tmp_path_factory.mktemp("data")
    closed_session(folder, 9)
    return folder


def test_known_people_lie_within_their_intervals(fits):
    within = [one.low <= getattr(person, one.name) <= one.high for person, fitted in fits for one in fitted.numbers]
    assert len(within) >= 2 * 12 and np.mean(within) >= 0.9


def test_intervals_are_narrow_enough_to_tell_people_apart(fits):
    widths = {"mass_kg": 0.08, "damping_N_s_m": 0.4, "stiffness_along_N_m": 0.35, "movement_s": 0.1, "tremor_N": 0.25}
    for person, fitted in fits:
        numbers = {one.name: one for one in fitted.numbers}
        for key, width in widths.items():
            assert numbers[key].high - numbers[key].low < 2.0 * width * getattr(person, key), key


def test_a_number_that_recordings_do_not_show_is_named_and_no_delay_is_made_up_of_a_correction_that_is_not_there(fits):
    for person, fitted in fits:
        seen = [one.name for one in fitted.numbers]
        assert sorted((*seen, *fitted.unseen)) == sorted(Person._fields)
        assert {"force_max_N", "lead_max_m", "effort_N_s", "skill", "bias_m", "noise_corner_Hz"} <= set(fitted.unseen)
        if person.felt_gain == 0.0:
            assert "felt_delay_s" in fitted.unseen


def test_nothing_is_read_of_a_recording_but_motion_force_and_phase(data):
    path = sorted(of(data).glob("trials/*.parquet"))[0]
    recording = read_recording(path)
    way = Segment(*(tuple(recording.metadata[key]) for key in ("start_m", "end_m")))
    kept = ("t_s", "phase", "tip_x_m", "tip_y_m", "hand_fx_N", "hand_fy_N")
    bare = replace(recording, metadata={"hand": "force sensor"}, columns={key: recording.columns[key] for key in kept})
    for ours, theirs in zip(motion_of(bare, way), motion_of(recording, way), strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_turning_the_bench_turns_nothing_of_the_fit():
    """A path in another direction, walked alike, gives the same samples."""
    generator = np.random.default_rng(3)
    recording = read_recording_of(generator.standard_normal((400, 4)).cumsum(axis=0) * 1e-4)
    angle = 0.7
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    columns = dict(recording.columns)
    for pair in (("tip_x_m", "tip_y_m"), ("hand_fx_N", "hand_fy_N")):
        turned = np.column_stack([columns[key] for key in pair]) @ turn
        columns |= dict(zip(pair, turned.T, strict=True))
    start, end = np.array([0.1, 0.2]), np.array([0.3, 0.2])
    plain = motion_of(recording, Segment(tuple(start), tuple(end)))
    other = motion_of(replace(recording, columns=columns), Segment(tuple(start @ turn), tuple(end @ turn)))
    for ours, theirs in zip(plain[2:], other[2:], strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-9)


def read_recording_of(walk):
    """A recording of tip and force (n, 4) alone."""
    names = ("tip_x_m", "tip_y_m", "hand_fx_N", "hand_fy_N")
    columns = dict(zip(names, walk.T, strict=True))
    columns |= {"t_s": np.arange(len(walk)) * 1e-3, "phase": np.full(len(walk), MOVE)}
    return Recording(Path("walk"), columns=columns, words={"phase": PHASES}, complete=True)


def test_the_covariance_of_a_piece_is_that_of_smoothed_noise_and_tremor():
    """Against ticks drawn by the operator's own recursion."""
    person = AVERAGE.draw(np.random.default_rng(1))._replace(tremor_Hz=8.0, tremor_band_Hz=2.0)
    operator = new_operator(person, np.random.default_rng(2))[0]
    draws = np.random.default_rng(3).standard_normal((400_000, 2))
    x = signal.lfilter([operator.tremor_draw], [1.0, *-operator.tremor_keep], draws, axis=0)
    smooth = mean(mean(mean(x[20_000:])))[::10]
    found = [np.mean(smooth[: len(smooth) - lag] * smooth[lag:]) for lag in range(PIECE)]
    np.testing.assert_allclose(covariance(resonance(8.0, 2.0, 500))[0], found, atol=0.06)


def test_the_half_width_of_a_mean_is_students():
    values = np.random.default_rng(4).standard_normal(20)
    without = np.array([np.delete(values, i).mean() for i in range(20)])
    assert half_width(without) == pytest.approx(2.093 * values.std(ddof=1) / np.sqrt(20), rel=1e-3)


def test_the_spread_of_reactions_is_that_of_the_variance_less_what_the_fits_add():
    """Of normal numbers with a known error: their spread, covered in 95 % of all cases; none comes out as none."""
    generator = np.random.default_rng(5)
    for spread in (0.0, 0.03, 0.1):
        values = spread * generator.standard_normal((2000, 20)) + 0.02 * generator.standard_normal((2000, 20))
        value, low, high = np.array([spread_of(one, 0.02**2) for one in values]).T
        assert np.mean((low <= spread) & (spread <= high)) == pytest.approx(0.95, abs=0.03)
        assert np.sqrt(np.mean(value**2)) == pytest.approx(spread, abs=0.008)
        assert spread > 0.0 or np.mean(low == 0.0) > 0.95


def some_fit(label: str, mass: float, without: str = "") -> Fitted:
    middle = {key: AVERAGE.spreads[key].quantile(0.5, (0.1, 5000.0)) for key in RESTS_ON} | {"mass_kg": mass}
    numbers = [Estimate(key, value, 0.9 * value, 1.1 * value, "a bench") for key, value in middle.items()]
    return Fitted(label, 60, [one for one in numbers if one.name != without])


def test_the_file_of_one_person_has_values_and_that_of_several_mean_and_sd_and_the_unseen_is_assumed():
    one = population_of(population_text("one", [some_fit("01", 1.2, "felt_gain")], AVERAGE), "file")
    assert one.name == "one" and one.spreads["mass_kg"].value == 1.2
    assert "participant 01: 1.2 (1.08 to 1.32); a bench" in one.spreads["mass_kg"].source
    both = [some_fit("01", 1.2), some_fit("02", 1.6, "felt_gain")]
    two = population_of(population_text("two", both, AVERAGE), "file")
    assert two.spreads["mass_kg"].mean == 1.4 and two.spreads["mass_kg"].sd == pytest.approx(0.282843)
    for population in (one, two):
        for key in ("felt_gain", "force_max_N", "sees_cursor"):
            spread, usual = population.spreads[key], AVERAGE.spreads[key]
            assert spread.source.startswith("assumed, as in average: ")
            assert (spread.value, spread.low, spread.high) == (usual.value, usual.low, usual.high)
        assert population.draw(np.random.default_rng(1)).mass_kg > 0.0


def test_a_laboratory_fits_its_participant_and_simulates_it(tmp_path, capsys):
    study, people, again, short = (tmp_path / name for name in ("study", "people.toml", "again", "short.toml"))
    short.write_text((SHIPPED_FOLDER / "paper.toml").read_text().replace("\nblocks = 3 ", "\nblocks = 1 "))
    assert main(["study", str(short), "--operators", "1", "--seed", "4", "--out", str(study)]) == 0
    capsys.readouterr()
    assert main(["fit-operator", str(study), "--out", str(people), "--json"]) == 0
    (person,) = json.loads(capsys.readouterr().out)["people"]
    assert person["participant"] == "01" and person["trials"] == 20
    fitted, true = load_population(people), json.loads((study / "sub-01/ses-01/session.json").read_text())["person"]
    assert fitted.spreads["mass_kg"].value == pytest.approx(true["mass_kg"], rel=0.06)
    assert main(["study", str(short), "--operators", "1", "--population", str(people), "--out", str(again)]) == 0


def test_a_folder_without_whole_trials_is_refused_in_one_sentence(tmp_path, capsys, data):
    assert "there is no such folder" in refusal(capsys, "fit-operator", tmp_path / "none")
    assert "holds no trial that reached the end" in refusal(capsys, "fit-operator", tmp_path)
    assert "holds no trial of participant 07" in refusal(capsys, "fit-operator", data, "--participant", "07")
    bare = shutil.copytree(data, tmp_path / "bare")
    (of(bare) / "trials.csv").unlink()
    assert f"{of(bare)}: has no trials.csv, which says how" in refusal(capsys, "fit-operator", bare)
    assert main(["recover", str(bare)]) == 0
    assert main(["fit-operator", str(bare)]) == 0, "as the refusal advises"
    cut = tmp_path / "cut"
    with session_of(cut, trials=0) as session:
        crash_in_trial(session)
    assert "has no trials.csv" in refusal(capsys, "fit-operator", cut)
    few = tmp_path / "few"
    closed_session(few, LEAST_TRIALS - 1)
    assert f"01 has {LEAST_TRIALS - 1} whole trials on straight paths" in refusal(capsys, "fit-operator", few)


def test_a_damaged_recording_is_named_and_nothing_is_written(tmp_path, capsys, data):
    spoilt, out = shutil.copytree(data, tmp_path / "spoilt"), tmp_path / "people.toml"
    path = sorted(of(spoilt).glob("trials/*.parquet"))[4]
    flip_a_bit(path)
    assert f"{path}: file: " in refusal(capsys, "fit-operator", spoilt, "--out", out) and not out.exists()


def test_a_file_is_never_overwritten_and_a_population_must_exist(tmp_path, capsys, data):
    out = tmp_path / "people.toml"
    out.write_text("mine")
    assert f"{out}: exists" in refusal(capsys, "fit-operator", data, "--out", out) and out.read_text() == "mine"
    assert "unknown population 'nobody'" in refusal(capsys, "fit-operator", data, "--like", "nobody")


def test_a_hand_that_no_force_sensor_felt_is_refused(data):
    path = sorted(of(data).glob("trials/*.parquet"))[0]
    recording = read_recording(path)
    mouse = replace(recording, metadata=recording.metadata | {"hand": "mouse"})
    with pytest.raises(InputError, match="the hand moved the handle by mouse, no force sensor felt its arm"):
        motion_of(mouse, PAPER.paths[1])


def test_one_participant_of_several_is_read_alone(data):
    assert list(read_motions(data, "01")) == list(read_motions(data)) == ["01"]
