"""Simulated people: their numbers, what they do tick by tick, and that their trials are those of people."""

import re

import numpy as np
import pytest
from people import AVERAGE, noiseless, somebody
from protocols import PAPER
from scipy import signal, stats

from core import tick_log
from core.device import load_device
from core.files import InputError, shipped_names
from core.path import Arc, Polyline, Segment, build_path, line, point_at
from core.simulator.hand import grip_force, new_hand
from core.simulator.simulated_device import SimulatedDevice
from experiments.analysis.movement import along_path, mean_over_progress
from experiments.plan import PlannedTrial
from experiments.trial.operator import (
    Moment,
    begin_approach,
    minimum_jerk,
    new_operator,
    on_path,
    operate,
    take_handle,
)
from experiments.trial.population import LIMITS, SHIPPED_FOLDER, load_population
from experiments.trial.trial import Conditions, SimulatedTrial


@pytest.fixture
def refused(tmp_path):
    """The refusal of the average file with one line changed."""

    def refusal(key: str, line: str | None) -> str:
        text, count = re.subn(rf"^{key} = .*$", line or "", AVERAGE.text, flags=re.MULTILINE)
        path = tmp_path / "people.toml"
        path.write_text(text if count else f"{text}\n{line}\n")
        with pytest.raises(InputError) as error:
            load_population(path)
        assert str(error.value).startswith(str(path)) and "\n" not in str(error.value)
        return str(error.value)

    return refusal


def test_people_whose_error_comes_from_the_device_have_no_error_of_their_own_and_tune_nothing_to_findings():
    population = load_population("from-device")
    for key in ("bias_m", "curvature_m", "trial_bias_m", "felt_gain"):
        assert population.spreads[key].value == 0.0
    assert population.changed_after_findings == ()


@pytest.mark.parametrize("name", shipped_names(SHIPPED_FOLDER))
def test_the_same_seed_is_the_same_person_and_everybody_lies_within_the_file(name):
    population = load_population(name)
    people = [population.draw(np.random.default_rng(seed)) for seed in range(40)]
    assert people[5] == population.draw(np.random.default_rng(5)) != people[6]
    for person in people:
        for key, number in person._asdict().items():
            spread, (least, most) = population.spreads[key], LIMITS[key]
            low = next(v for v in (spread.value, spread.low, least) if v is not None)
            high = next(v for v in (spread.value, spread.high, most) if v is not None)
            assert low <= number <= high, key


def test_a_normal_number_is_normal_and_cut_at_its_limits(tmp_path):
    path = tmp_path / "people.toml"
    lines = {"bias_m": "{mean = 0.0, sd = 0.006", "tremor_Hz": "{mean = 4.0, sd = 1.0"}
    text = AVERAGE.text
    for key, numbers in lines.items():
        text = re.sub(rf"^{key} = .*$", f'{key} = {numbers}, source = "test"}}', text, flags=re.MULTILINE)
    path.write_text(text)
    population, generator = load_population(path), np.random.default_rng(1)
    people = [population.draw(generator) for _ in range(500)]
    assert stats.kstest([person.bias_m for person in people], "norm", (0.0, 0.006)).pvalue > 0.01
    least = LIMITS["tremor_Hz"][0]
    cut = stats.truncnorm(least - 4.0, LIMITS["tremor_Hz"][1] - 4.0, loc=4.0)
    assert stats.kstest([person.tremor_Hz for person in people], cut.cdf).pvalue > 0.01


def test_a_seed_is_the_same_place_in_every_population():
    """So that populations can be compared person by person."""
    for seed in range(5):
        steady, average = (load_population(name).draw(np.random.default_rng(seed)) for name in ("steady", "average"))
        assert steady.mass_kg == average.mass_kg and steady.bias_m == average.bias_m
        assert steady.tremor_N < average.tremor_N


@pytest.mark.parametrize(
    ("key", "line", "said"),
    [
        ("mass_kg", None, "required key mass_kg is missing"),
        ("mass_kg", 'mass_kg = {source = "x"}', "mass_kg: must hold value, or low and high, or mean and sd, not none"),
        ("mass_kg", 'mass_kg = {low = 2.0, high = 1.0, source = "x"}', "mass_kg: low (2) must not exceed high (1)"),
        ("mass_kg", 'mass_kg = {mean = 1.0, sd = -1.0, source = "x"}', "mass_kg: sd must be between 0 and 10, not -1"),
    ],
)
def test_a_file_that_cannot_be_meant_is_refused_by_file_key_and_reason(refused, key, line, said):
    assert said in refused(key, line)


BOW = Arc((0.0, 0.36), 0.08, 180.0, 0.0)


class Scripted:
    """An operator whose handle moves by a script instead of a device: its targets and what it adds."""

    def __init__(self, person, path, noise=None):
        self.path, self.hand = path, new_hand()
        take_handle(person, path, self.hand.grips)
        self.operator, self.grip = new_operator(person, np.random.default_rng(1)), self.hand.grips[0]
        self.noise = np.zeros((1, 2)) if noise is None else noise
        begin_approach(self.operator[0], path.x0, path.y0, path)

    def move(self, tips, phase=tick_log.MOVE):
        """Ticks of one phase at tips (n, 2); targets (n, 2) and the added force (n, 2)."""
        targets, held = np.empty((len(tips), 2)), np.empty((len(tips), 2))
        for tick, (x, y) in enumerate(tips):
            operate(self.operator[0], self.grip, self.path, Moment(phase, tick, tick), (x, y), self.noise)
            targets[tick], held[tick] = self.grip.target[:2], self.grip.held
        return targets, held


@pytest.mark.nojit
def test_minimum_jerk_starts_and_ends_at_rest_and_is_fastest_in_the_middle():
    share, slope = np.array([minimum_jerk(r) for r in np.linspace(0.0, 1.0, 101)]).T
    assert (share[0], share[-1], slope[0], slope[-1]) == (0.0, 1.0, 0.0, 0.0)
    assert np.all(np.diff(share) > 0.0) and slope.argmax() == 50
    assert slope.max() == pytest.approx(1.875)  # peak speed 1.875 L / T, Flash & Hogan 1985
    np.testing.assert_allclose(np.gradient(share, 0.01)[1:-1], slope[1:-1], atol=2e-3)


@pytest.mark.parametrize("sense", ["felt", "seen"])
@pytest.mark.nojit
def test_a_sideways_push_is_answered_after_the_delay_of_its_sense_and_towards_the_path(sense):
    path, at = line((-0.1, 0.4), (0.1, 0.4)), 200
    person = noiseless(somebody(2, give_up_per_s=0.0, reaction_s=0.0, bias_m=0.0, curvature_m=0.0))
    person = person._replace(seen_gain_per_s=0.0) if sense == "felt" else person._replace(felt_gain=0.0)
    tips = np.stack([np.linspace(-0.1, -0.05, 500), np.full(500, 0.4)], axis=1)
    pushed = tips.copy()
    pushed[at:, 1] += 0.008
    answer = Scripted(person, path).move(pushed)[0] - Scripted(person, path).move(tips)[0]
    delay = {"felt": 60, "seen": 130}[sense]
    assert np.all(answer[: at + delay] == 0.0)
    assert np.all(answer[at + delay + 100 :, 1] < -1e-4)


def test_without_a_cursor_nothing_is_seen_of_the_error_on_the_way_and_all_of_it_at_the_end():
    path = line((-0.1, 0.4), (0.1, 0.4))
    person = noiseless(somebody(2, give_up_per_s=0.0, reaction_s=0.0, movement_s=1.0, bias_m=0.0, curvature_m=0.0))
    person = person._replace(felt_gain=0.0)
    tips = np.stack([np.linspace(-0.1, 0.1, 2000), np.full(2000, 0.4)], axis=1)
    pushed = tips + (0.0, 0.008)
    answers = []
    for cursor in (0.0, 0.5, 1.0):
        led = person._replace(sees_cursor=cursor)
        answers.append((Scripted(led, path).move(pushed)[0] - Scripted(led, path).move(tips)[0])[:, 1])
    blind, half, seeing = answers
    assert np.all(blind[:1000] == 0.0) and blind[-1] < -0.003
    assert seeing[999] < 1.5 * half[999] < -1e-3


def test_a_handle_that_stands_beside_the_end_is_pulled_at_the_end_by_people_who_aim_at_it():
    path = line((-0.1, 0.4), (0.1, 0.4))
    person = noiseless(somebody(6, reaction_s=0.2, movement_s=0.5, felt_gain=0.0, bias_m=0.0, curvature_m=0.0))
    beside = np.tile((0.1, 0.412), (4000, 1))
    for aims in (0.0, 1.0):
        hand = Scripted(person._replace(aims_at_end=aims), path)
        targets, held = hand.move(beside)
        assert (targets[-1, 1] - 0.412 < -0.02) == (aims == 1.0)
        assert (held[-1, 0] == pytest.approx(person.effort_max_N)) == (aims == 0.0)


@pytest.mark.nojit
def test_turning_the_scene_turns_what_the_operator_does():
    person, n = noiseless(somebody(3)), 400
    generator = np.random.default_rng(0)
    tips = np.stack([np.linspace(-0.1, -0.06, n), 0.4 + 0.005 * np.sin(np.linspace(0, 3, n))], axis=1)
    angle = generator.uniform(0.5, 2.5)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    start, end = np.array([-0.1, 0.4]), np.array([0.1, 0.4])
    straight, turned = Scripted(person, line(start, end)), Scripted(person, line(turn @ start, turn @ end))
    for plain, other in zip(straight.move(tips), turned.move(tips @ turn.T), strict=True):
        np.testing.assert_allclose(other, plain @ turn.T, atol=1e-12)
    k = straight.grip.stiffness
    turned_k = turn @ np.array([[k[0], k[1]], [k[1], k[2]]]) @ turn.T
    np.testing.assert_allclose(turned.grip.stiffness, [turned_k[0, 0], turned_k[0, 1], turned_k[1, 1]], atol=1e-9)


def test_on_a_bend_the_arm_stays_soft_along_the_path_and_stiff_across_it():
    path, person = build_path(BOW, "bow"), noiseless(somebody(4, reaction_s=0.0, movement_s=2.0, lead_max_m=0.5))
    hand = Scripted(person, path)
    hand.move(np.tile((path.x0, path.y0), (1000, 1)))
    ux, uy = hand.operator[0].direction
    progress = minimum_jerk(hand.operator[0].progress)[0] * path.length
    _, _, tx, ty = point_at(path, progress)
    assert ux * tx + uy * ty > np.cos(0.35)  # the arm follows the bend, a little late
    assert tx > 0.9 > 0.1 > abs(point_at(path, 0.0)[2])  # a quarter turn so far
    k = hand.grip.stiffness
    along = k[0] * ux * ux + 2.0 * k[1] * ux * uy + k[2] * uy * uy
    across = k[0] * uy * uy - 2.0 * k[1] * ux * uy + k[2] * ux * ux
    assert (along, across) == pytest.approx((person.stiffness_along_N_m, person.stiffness_across_N_m))


def test_at_a_handle_that_stands_the_push_grows_to_its_limit_and_eases_once_the_handle_moves():
    path = line((-0.1, 0.4), (0.1, 0.4))
    person = noiseless(somebody(6, reaction_s=0.2))
    hand = Scripted(person, path)
    stuck = np.tile((-0.05, 0.41), (4000, 1))
    targets, held = hand.move(stuck)
    assert np.all(held[:400] == 0.0)
    assert np.all(np.diff(held[500:, 0]) >= 0.0) and held[-1, 0] == pytest.approx(person.effort_max_N)
    assert np.all(held[:, 1] == 0.0)  # along the path
    # the virtual hand waits, and gives up its sideways pull
    assert (targets[:, 0] - stuck[:, 0]).max() < person.lead_max_m + 1e-3
    assert abs(targets[-1, 1] - 0.41) < 0.2 * np.abs(targets[:, 1] - 0.41).max()
    away = np.stack([np.linspace(-0.05, 0.05, 1000), np.full(1000, 0.41)], axis=1)
    assert hand.move(away)[1][-1, 0] < 0.01 * person.effort_max_N


def test_the_arm_never_pushes_harder_than_its_clip():
    path, generator = line((-0.1, 0.4), (0.1, 0.4)), np.random.default_rng(5)
    person = somebody(7, noise_share=0.2, tremor_N=3.0, force_max_N=30.0)
    hand, strongest = Scripted(person, path, generator.standard_normal((4096, 2))), 0.0
    for tick in range(3000):
        x, y = (-0.1, 0.4) if tick < 1500 else generator.uniform(-0.3, 0.6, 2)
        operate(hand.operator[0], hand.grip, path, Moment(tick_log.MOVE, tick, tick), (x, y), hand.noise)
        force = np.hypot(*grip_force(hand.grip, x, y, *generator.uniform(-1.0, 1.0, 2)))
        strongest = max(strongest, force)
        assert force <= person.force_max_N * (1.0 + 1e-12)
    assert strongest > 0.9 * person.force_max_N


def test_a_hand_is_led_off_a_small_path_with_bends_in_proportion_to_its_size_and_off_a_straight_one_as_ever():
    person = somebody(1, bias_m=0.006, curvature_m=0.004, trial_bias_m=0.003)
    corners = np.array([[0.0, 0.0], [0.06, 0.0], [0.06, 0.08]])  # 10 cm in size, half of the paper's
    small, large = (on_path(person, build_path(Polyline(tuple(map(tuple, k * corners))), "path")) for k in (1.0, 3.0))
    assert (small.bias_m, small.curvature_m, small.trial_bias_m) == pytest.approx((0.003, 0.002, 0.0015))
    assert large.bias_m == person.bias_m and on_path(person, line((0.0, 0.1), (0.02, 0.1))) is person


def test_tremor_has_the_frequency_and_the_size_of_its_person_and_tremulous_people_have_most():
    path, noise = line((-0.1, 0.4), (0.1, 0.4)), np.random.default_rng(6).standard_normal((1 << 16, 2))
    still, sizes = np.tile((-0.1, 0.4), (20_000, 1)), []
    for name in ("steady", "average", "tremulous"):
        person = load_population(name).draw(np.random.default_rng(9))._replace(noise_share=0.0)
        held = Scripted(person, path, noise).move(still, tick_log.HOLD)[1]
        rms = np.sqrt(np.mean(held**2, axis=0))
        np.testing.assert_allclose(rms, person.tremor_N, rtol=0.2)
        frequency, power = signal.welch(held[:, 0], 1000.0, nperseg=8192)
        in_band = np.abs(frequency - person.tremor_Hz) < 2.0 * person.tremor_band_Hz
        assert power[in_band].sum() > 0.8 * power.sum()
        sizes.append(person.tremor_N)
    assert sizes == sorted(sizes)


def test_force_noise_grows_with_the_force_and_is_slow():
    path, noise = line((-0.1, 0.4), (0.1, 0.4)), np.random.default_rng(7).standard_normal((1 << 16, 2))
    person, spreads = somebody(10, tremor_N=0.0, noise_share=0.05, seen_gain_per_s=0.0), []
    for away in (0.01, 0.03):
        hand = Scripted(person, path, noise)
        tips = np.tile((-0.1, 0.4 + away), (20_000, 1))
        hand.operator["progress"][0] = 1.0
        held = hand.move(tips, tick_log.HOLD)[1]
        spreads.append(held[1000:].std())
        assert spreads[-1] == pytest.approx(0.05 * person.stiffness_across_N_m * away, rel=0.2)
        frequency, power = signal.welch(held[1000:, 0], 1000.0, nperseg=4096)
        assert power[frequency < 10.0].sum() > 0.6 * power.sum() > 10.0 * power[frequency > 100.0].sum()
    assert spreads[1] == pytest.approx(3.0 * spreads[0], rel=1e-6)


DEVICES = {name: load_device(name) for name in ("three-brake", "four-brake")}
FLAT = Segment((-0.1, 0.4), (0.1, 0.4))
CORNER = Polyline(((-0.1, 0.34), (0.0, 0.42), (0.1, 0.34)))


def new_trial(person, number=1, path=FLAT, seed=3, device="three-brake", simulation=None):
    simulation = simulation or SimulatedDevice(DEVICES[device], (0.0, 0.38))
    return SimulatedTrial(
        simulation,
        PlannedTrial(1, 1, device, number, 1, 1),
        Conditions(path, PAPER.controllers[number], "settled"),
        person=person,
        generator=np.random.default_rng(seed),
    )


def one_trial(person, number=1, path=FLAT, **how):
    trial = new_trial(person, number, path, **how)
    rows = np.zeros((80_000, tick_log.WIDTH))
    return trial, rows[: trial.run(rows)]


def moving(rows):
    return rows[rows[:, tick_log.PHASE] == tick_log.MOVE]


def test_the_same_seed_is_the_same_trial_and_another_seed_another_one_but_for_people_without_noise():
    person = somebody(5)
    first, again, other = (one_trial(person, seed=seed)[1] for seed in (3, 3, 4))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)
    first, other = (one_trial(noiseless(person), seed=seed)[1] for seed in (3, 4))
    np.testing.assert_array_equal(first, other)


def test_phases_follow_one_another_and_the_start_is_held_for_half_a_second():
    trial, rows = one_trial(somebody(1))
    phases = rows[:, tick_log.PHASE]
    move, end = np.flatnonzero(phases == tick_log.MOVE), np.flatnonzero(phases == tick_log.END)
    assert trial.outcome()["status"] == "done"
    assert np.all(np.diff(phases[move[0] :]) >= 0) and len(end) == 300
    held = rows[move[0] - 500 : move[0]]
    assert np.all(held[:, tick_log.PHASE] == tick_log.HOLD)
    assert np.hypot(held[:, tick_log.TIP_X] - FLAT.start_m[0], held[:, tick_log.TIP_Y] - FLAT.start_m[1]).max() <= 0.003
    assert np.hypot(rows[end[0], tick_log.TIP_X] - FLAT.end_m[0], rows[end[0], tick_log.TIP_Y] - FLAT.end_m[1]) <= 0.01
    assert np.all(
        rows[phases != tick_log.MOVE, tick_log.CURRENT : tick_log.CURRENT + 4] == 0.0
    )  # brakes off outside `move`


@pytest.mark.parametrize("path", [FLAT, CORNER, BOW], ids=["segment", "corner", "bow"])
def test_an_unaided_operator_follows_any_path_to_its_end_without_a_jump_of_the_virtual_hand(path):
    for seed in range(3):
        trial, rows = one_trial(somebody(seed), path=path)
        move = moving(rows)
        assert trial.outcome()["status"] == "done"
        assert np.abs(move[:, tick_log.PATH_DISTANCE]).max() < 0.03
        assert np.abs(np.diff(move[:, [tick_log.TARGET_X, tick_log.TARGET_Y]], axis=0)).max() < 1e-3


def path_error(move, path):
    """The measure of trials.csv, m."""
    progress, distance = along_path(move[:, [tick_log.TIP_X, tick_log.TIP_Y]], build_path(path, "path"))
    return mean_over_progress(distance, progress)


def test_unaided_people_err_push_and_move_within_the_ranges_they_are_set_to():
    """Most trials on the three-brake device lie in the ranges of path error, force and speed of decision 08."""
    error, force, speed = [], [], []
    for seed in range(10):
        for path in PAPER.paths.values():
            trial, rows = one_trial(somebody(seed), path=path, seed=seed)
            move = moving(rows)
            assert trial.outcome()["status"] == "done"
            error.append(path_error(move, path))
            force.append(np.hypot(move[:, tick_log.HAND_FX], move[:, tick_log.HAND_FY]).mean())
            speed.append(np.hypot(move[:, tick_log.TIP_VX], move[:, tick_log.TIP_VY]).max())
    for values, low, high in ((error, 0.0011, 0.0042), (force, 1.9, 4.4), (speed, 0.11, 0.24)):
        assert np.mean([low <= value <= high for value in values]) > 0.65
        assert low < np.median(values) < high


def test_the_device_alone_takes_an_unaided_hand_further_off_than_the_gap_and_the_heavier_one_further():
    """Decision 13; the gap of the paper's SDOF controller is 5 mm."""
    people = [load_population("from-device").draw(np.random.default_rng(seed)) for seed in range(24)]
    error = {name: [] for name in DEVICES}
    for name, errors in error.items():
        for seed, person in enumerate(people):
            simulation = SimulatedDevice(DEVICES[name], (0.0, 0.38))
            # where a trial ended is where the next one sets out from: the order of the paths is random, as in a study
            for path in np.random.default_rng(seed).permutation([*PAPER.paths.values()] * 2):
                trial, rows = one_trial(person, path=path, seed=seed, device=name, simulation=simulation)
                if trial.outcome()["status"] == "done":
                    errors.append(path_error(moving(rows), path))
        assert len(errors) > 44  # of 48
    assert np.median(error["three-brake"] + error["four-brake"]) > 0.0055
    assert 0.004 < np.median(error["three-brake"]) < 0.85 * np.median(error["four-brake"])


@pytest.mark.parametrize("name", DEVICES)
def test_steady_people_reach_the_end_whatever_the_controller(name):
    steady = load_population("steady")
    for seed in range(2):
        person, simulation = steady.draw(np.random.default_rng(seed)), SimulatedDevice(DEVICES[name], (0.0, 0.38))
        for path in PAPER.paths.values():
            for number in PAPER.controllers:
                trial, _ = one_trial(person, number, path, seed=seed, device=name, simulation=simulation)
                assert trial.outcome()["status"] == "done", (seed, path, number)


def test_the_mass_of_the_arm_is_on_the_hands_side_of_the_force_sensor():
    """The sensor reads what the arm exerts less what its own mass takes."""
    person = somebody(8)
    trial = new_trial(person)
    tick, taken, seen = np.zeros((1, tick_log.WIDTH)), 0.0, 0
    grip = trial.simulation.hand.grips[0]
    while not trial.finished and trial.ticks < 3000:
        trial.run(tick)
        at = tick[0]
        arm = grip_force(grip, at[tick_log.TIP_X], at[tick_log.TIP_Y], at[tick_log.TIP_VX], at[tick_log.TIP_VY])
        inertial = person.mass_kg * at[[tick_log.TIP_AX, tick_log.TIP_AY]]
        np.testing.assert_allclose(at[[tick_log.HAND_FX, tick_log.HAND_FY]], arm - inertial, atol=1e-9)
        taken, seen = max(taken, np.hypot(*inertial)), seen + 1
    assert taken > 0.3 and seen == 3000


def test_a_hand_force_that_is_not_finite_ends_the_trial_with_brakes_off():
    simulation = SimulatedDevice(DEVICES["three-brake"], (0.0, 0.38))
    trial = SimulatedTrial(
        simulation, PlannedTrial(1, 1, "three-brake", 2, 1, 1), Conditions(FLAT, PAPER.controllers[2], "settled")
    )
    trial.aim(float("nan"), 0.4)
    rows = np.zeros((1000, tick_log.WIDTH))
    n = trial.run(rows)
    assert trial.finished and trial.outcome()["status"] == "aborted"
    assert "not finite" in trial.outcome()["reason"]
    assert np.isfinite(rows[:n, : tick_log.ARM_FORCE_MAX]).all()
    assert np.all(rows[:n, tick_log.CURRENT : tick_log.CURRENT + 4] == 0.0)
