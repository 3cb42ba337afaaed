"""A person: the numbers of one simulated operator, drawn from a population (`experiments/trial/population.py`)."""

from typing import NamedTuple


class Person(NamedTuple):
    """One simulated operator: what a population file gives a range of, under the same names (SI units; Hz)."""

    stiffness_along_N_m: float  # of the arm, in the direction of the path
    stiffness_across_N_m: float
    damping_N_s_m: float  # in every direction
    mass_kg: float  # of the arm at the handle, on the hand's side of the force sensor
    force_max_N: float  # the arm's force is clipped here
    movement_s: float  # duration of the virtual hand's movement along the path
    reaction_s: float  # from go to the start of the movement
    reaction_spread_s: float  # sd of it from trial to trial
    approach_speed_m_s: float  # mean speed towards the start
    approach_least_s: float  # duration of the shortest approach
    bias_m: float  # lateral offset of the virtual hand in the middle of the path, + left
    curvature_m: float  # height of the S in the virtual hand's way
    trial_bias_m: float  # sd of the bias from trial to trial
    skill: float  # bias, its change from trial to trial, and curvature are divided by it
    felt_delay_s: float
    felt_gain: float  # the virtual hand moves this share of the felt distance towards the path
    seen_delay_s: float
    seen_gain_per_s: float  # rate at which the seen distance is corrected
    seen_least_m: float  # smaller distances are left alone
    foresight_s: float  # a correction waits for a handle that will be there by itself within this time
    settle_speed_m_s: float  # a correction on the approach waits for a handle that moves as fast as this
    correction_max_m: float  # of the virtual hand, in either direction
    lead_max_m: float  # the virtual hand waits for a handle that lags more
    still_speed_m_s: float  # a slower handle is felt to stand
    give_up_per_s: float  # rate at which a sideways pull is given up while the handle stands
    effort_N_s: float  # growth of a push along the path while the handle stands
    effort_max_N: float
    effort_ease_per_s: float  # rate at which that push is given up once the handle moves
    turn_s: float  # in which the virtual hand's direction follows a bend of the path
    noise_share: float  # sd of the force noise per axis, share of the force
    noise_corner_Hz: float  # of its low-pass
    tremor_N: float  # rms per axis
    tremor_Hz: float
    tremor_band_Hz: float  # width of the tremor's peak at half power


def noiseless(person: Person) -> Person:
    """The same person without noise, tremor, or change from trial to trial."""
    return person._replace(noise_share=0.0, tremor_N=0.0, trial_bias_m=0.0, reaction_spread_s=0.0)
