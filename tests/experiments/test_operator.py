"""What the simulated operator does tick by tick, its handle led by a script: delays, corrections, stalls, unrest."""

import numpy as np
import pytest
from people import noiseless, somebody
from scipy import signal

from core import tick_log
from core.path import Arc, Polyline, build_path, line, point_at
from core.simulator.hand import grip_force, new_hand
from experiments.trial.operator import (
    Moment,
    begin_approach,
    minimum_jerk,
    new_operator,
    on_path,
    operate,
    take_handle,
)
from experiments.trial.population import load_population

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


def test_a_hand_is_led_off_a_small_path_with_bends_in_proportion_to_its_size_and_off_a_straight_one_as_ever():
    person = somebody(1, bias_m=0.006, curvature_m=0.004, trial_bias_m=0.003)
    corners = np.array([[0.0, 0.0], [0.06, 0.0], [0.06, 0.08]])  # 10 cm in size, half of the paper's
    small, large = (on_path(person, build_path(Polyline(tuple(map(tuple, k * corners))), "path")) for k in (1.0, 3.0))
    assert (small.bias_m, small.curvature_m, small.trial_bias_m) == pytest.approx((0.003, 0.002, 0.0015))
    assert large.bias_m == person.bias_m and on_path(person, line((0.0, 0.1), (0.02, 0.1))) is person
