"""The measures of smoothness on signals whose answers are known: acceleration, its weighted DFT, SPARC."""

import numpy as np
import pytest

from experiments.analysis import metrics as m


@pytest.mark.parametrize("frequency, amplitude", [(1.0, 0.5), (7.0, 2.0), (100.0, 0.3)])
def test_dft_sum_of_a_sinusoid_is_its_frequency_times_its_amplitude(frequency, amplitude):
    t = np.arange(2000) / 1000.0
    wave = amplitude * np.sin(2 * np.pi * frequency * t + 0.3)
    for acceleration in (np.column_stack([wave, 0 * t]), np.column_stack([5.0 - 0.6 * wave, 0.8 * wave - 3.0])):
        assert m.acceleration_dft_sum(acceleration) == pytest.approx(frequency * amplitude, rel=1e-9)
        assert m.acceleration_weighted_rms(acceleration) == pytest.approx(frequency * amplitude / 2**0.5, rel=1e-9)


def test_frequencies_add_and_those_above_100_hz_do_not_count():
    t = np.arange(3000) / 1000.0
    tones = [(2.0, 1.0), (30.0, 0.1), (101.0, 50.0)]
    wave = sum(a * np.cos(2 * np.pi * f * t) for f, a in tones)
    acceleration = np.column_stack([wave, 0 * t])
    assert m.acceleration_dft_sum(acceleration) == pytest.approx(2.0 + 3.0, rel=1e-9)
    assert m.acceleration_weighted_rms(acceleration) == pytest.approx(np.sqrt((4.0 + 9.0) / 2), rel=1e-9)


def test_dft_sum_matches_the_definition_summed_term_by_term():
    acceleration = np.random.default_rng(3).normal(size=(307, 2))  # a prime number of samples
    n, total, squares = 307, 0.0, 0.0
    centred = acceleration - acceleration.mean(axis=0)
    for k in range(1, n):
        f = k * 1000.0 / n
        if f <= 100.0:
            wave = np.exp(-2j * np.pi * k * np.arange(n) / n)
            a = np.sqrt(abs(2 / n * centred[:, 0] @ wave) ** 2 + abs(2 / n * centred[:, 1] @ wave) ** 2)
            total, squares = total + f * a, squares + f**2 * a**2
    assert m.acceleration_dft_sum(acceleration) == pytest.approx(total, rel=1e-12)
    assert m.acceleration_weighted_rms(acceleration) == pytest.approx(np.sqrt(0.5 * squares), rel=1e-12)


def test_longer_noise_raises_the_dft_sum_but_not_the_weighted_rms():
    noise = np.random.default_rng(4).normal(size=(16000, 2))
    short, long = noise[:4000], noise
    assert m.acceleration_dft_sum(long) / m.acceleration_dft_sum(short) == pytest.approx(2.0, rel=0.05)
    assert m.acceleration_weighted_rms(long) / m.acceleration_weighted_rms(short) == pytest.approx(1.0, rel=0.05)


def test_acceleration_of_the_tip_is_that_of_a_slow_motion_and_forgets_steps_of_an_encoder():
    t = np.arange(6000) / 1000.0
    w = 2 * np.pi * 1.0
    tip = np.column_stack([0.05 * np.sin(w * t), 0.3 + 0.02 * np.cos(w * t)])
    true = -w * w * (tip - (0.0, 0.3))
    inside = slice(500, 5500)
    assert m.tip_acceleration(tip)[inside] == pytest.approx(true[inside], abs=1e-3 * w * w * 0.05)
    coarse = np.round(tip / 20e-6) * 20e-6
    assert m.tip_acceleration(coarse)[inside] == pytest.approx(true[inside], abs=0.1)
    assert m.tip_acceleration(tip[:10]) is None


def test_acceleration_filter_halves_the_power_twice_at_20_hz():
    """Forward and backward: at the cut-off the gain is 1/2, with no delay."""
    t = np.arange(8000) / 1000.0
    w = 2 * np.pi * 20.0
    tip = np.column_stack([1e-3 * np.sin(w * t), 0 * t])
    step = 2e-3
    two_differences = -((2 * np.sin(w * step / 2) / step) ** 2) * tip  # exact gain of two central differences
    inside = slice(1000, 7000)
    assert m.tip_acceleration(tip)[inside, 0] == pytest.approx(0.5 * two_differences[inside, 0], abs=1e-3)


def test_sparc_agrees_with_monalysa():
    smoothness = pytest.importorskip("monalysa.quality.smoothness")
    generator = np.random.default_rng(5)
    for n in (150, 700, 1024, 4001):
        t = np.arange(n) / 1000.0
        bell = 30 * (t / 4) ** 2 * (1 - t / 4) ** 2 + 0.01
        for speed in (bell, np.abs(bell + 0.2 * generator.normal(size=n)), bell * (1 + 0.5 * np.sin(40 * t))):
            oracle, _, _ = smoothness.sparc(speed, fs=1000.0, padlevel=4, fc=10.0, amp_th=0.05)
            assert m.sparc(speed) == pytest.approx(oracle, rel=1e-9)


def test_sparc_of_a_minimum_jerk_motion_is_that_of_the_literature_and_shaking_worsens_it():
    """Minimum jerk gives about -1.4 whatever duration and scale (Balasubramanian et al. 2015)."""
    values = []
    for duration in (1.0, 2.0, 4.0):
        r = np.arange(int(1000 * duration)) / (1000 * duration)
        speed = 30 * r**2 * (1 - r) ** 2
        values.append(m.sparc(speed))
        assert m.sparc(7.0 * speed) == pytest.approx(values[-1], rel=1e-12)
        assert m.sparc(speed * (1 + 0.5 * np.sin(2 * np.pi * 4 * r * duration))) < values[-1] - 0.1
    assert np.ptp(values) < 0.02 and all(-1.5 < value < -1.38 for value in values)
    assert m.sparc(np.zeros(100)) is None
