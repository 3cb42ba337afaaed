"""The arm behind a recorded hand: stiffness, damping, mass, and the late corrections of a felt and a seen error.

    force = K (virtual hand - x) - D v - m a + unrest
    virtual hand across the path = slow course - gain x(felt delay ago) + rate * (sum of the error seen, delay ago)

The brakes switch, and so move the handle in ways that the hand did not choose: that tells its answer from its will. The
slow course is a polynomial in each run. Least squares on samples whitened by the residuals' own autoregression; delays
by the smallest residual on a grid. What the hand's own noise does through the handle biases them a little:
`experiments/operator_fit/fit.py` widens the intervals by it. A jerk term takes up a clock of the force that is late.
"""

from typing import NamedTuple

import numpy as np
from scipy import stats
from scipy.linalg import qr, toeplitz
from scipy.optimize import least_squares

from core.files import InputError
from experiments.operator_fit.motions import SAMPLE_S, Motion
from experiments.trial.operator import minimum_jerk

ORDER = 10  # of the autoregression
#: N. Our choice: so much white noise of sensors is taken to lie in the residuals of any recording (20 um steps of a
#: handle whose arm weighs 1 kg), so that frequencies at which a hand is quieter decide nothing.
SENSORS_N = 0.1
SETTLED = round(0.5 / SAMPLE_S)  # samples after go: the reaction is over
STALL_M_S, AFTER_STALL = 0.006, round(0.2 / SAMPLE_S)  # a handle that stands, or stood before, is left out
LEAST_RUN = 60  # samples
FELT = np.arange(2, 13)  # samples of delay that are tried
SEEN = np.arange(6, 27)
ROUNDS = 6  # of both delays in turn; two that keep changing places are of one likelihood, and the last ones are kept
GLANCE = round(0.05 / SAMPLE_S)  # as the operator feels motion
MOST_LEAD_M = 0.055  # a hand that leads by more waits
SHARP = 50.0  # of a logarithm of likelihood. Our choice: less is made by the hand's own noise, too
ACROSS = (
    "stiffness_across_N_m", "damping_N_s_m", "mass_kg", "felt_gain", "seen_gain_per_s", "felt_delay_s", "seen_delay_s",
)  # fmt: skip
CORRELATED = 50  # samples: residuals of a course that are further apart are taken to be independent


def runs(wanted: np.ndarray) -> np.ndarray:
    """First and end (m, 2) of every run of True."""
    return np.flatnonzero(np.diff(np.concatenate([[0], wanted.astype(np.int8), [0]]))).reshape(-1, 2)


class Run(NamedTuple):
    """n samples in which the handle moved all the time, of one trial."""

    trial: int
    regressors: np.ndarray  # (n, q)
    force: np.ndarray  # (n,)
    course: np.ndarray  # (n, p) what the slow will may look like


class NormalEquations(NamedTuple):
    """The normal equations of the least squares of each trial: any choice of trials is solved by adding them."""

    matrix: np.ndarray  # (trials, q, q)
    vector: np.ndarray  # (trials, q)
    square: np.ndarray  # (trials,)

    def solve(self, keep: np.ndarray) -> tuple[np.ndarray, float]:
        """Solve the trials where keep (trials,) is true: the numbers (q,) and the sum of squared residuals."""
        matrix, vector = self.matrix[keep].sum(axis=0), self.vector[keep].sum(axis=0)
        found = np.linalg.solve(matrix, vector)
        return found, float(self.square[keep].sum() - vector @ found)


def delayed(z: np.ndarray, samples: int) -> np.ndarray:
    """z (n,) delayed by this many samples; at the beginning its first value."""
    return np.concatenate([np.full(samples, z[0]), z[: len(z) - samples]])


def course(n: int, degree: int) -> np.ndarray:
    """Polynomials (n, degree + 1)."""
    return np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, n), degree)


def across_runs(trials: list[Motion], felt: int, seen: int, least_m: float, foresight_s: float) -> list[Run]:
    """Runs of the movement across the path, with these delays (samples)."""
    found = []
    for number, trial in enumerate(trials):
        x = trial.x[:, 1]
        rate = (delayed(x, felt) - delayed(x, felt + GLANCE)) / (GLANCE * SAMPLE_S)
        error = -delayed(x, seen)
        left = np.abs(error) - least_m - foresight_s * rate * np.sign(error)
        wanted = np.where(np.abs(error) > least_m, np.maximum(left, 0.0) * np.sign(error), 0.0)
        still = np.convolve(trial.speed < STALL_M_S, np.ones(AFTER_STALL))[: len(x)] > 0.5
        use = np.zeros(len(x), bool)
        use[trial.moving[SETTLED:]] = True
        for start, end in runs(use & ~still):
            if end - start >= LEAST_RUN:
                part = slice(start, end)
                seen_sum = (np.cumsum(wanted[part]) - 0.5 * wanted[part]) * SAMPLE_S
                columns = -x[part], -trial.v[part, 1], -trial.a[part, 1], -delayed(x, felt)[part], seen_sum
                regressors = np.column_stack([*columns, -trial.jerk[part, 1]])
                degree = 2 + (end - start) // 100
                found.append(Run(number, regressors, trial.force[part, 1], course(end - start, degree)))
    return found


def along_runs(trials: list[Motion], damping: float, mass: float) -> list[Run]:
    """Runs along the path, damping and mass known: of the movement, and after its end, where the virtual hand rests."""
    found = []
    for number, trial in enumerate(trials):
        rest = trial.force[:, 0] + damping * trial.v[:, 0] + mass * trial.a[:, 0]
        still = np.convolve(trial.speed < STALL_M_S, np.ones(2 * AFTER_STALL))[: len(rest)] > 0.5
        use = np.zeros(len(rest), bool)
        use[trial.moving[SETTLED - AFTER_STALL :]] = True
        use &= ~still & (trial.x[:, 0] < 0.85 * trial.length)
        parts = [(slice(start, end), 1 + (end - start) // 30) for start, end in runs(use) if end - start >= LEAST_RUN]
        if len(trial.ended) > 2 * ORDER and not still[trial.ended[0]]:
            parts.append((slice(trial.ended[0], trial.ended[-1] + 1), 0))
        for part, degree in parts:
            regressors = np.column_stack([-trial.x[part, 0], -trial.jerk[part, 0]])
            found.append(Run(number, regressors, rest[part], course(len(regressors), degree)))
    return found


def whiten(found: list[Run], trials: int, memory: np.ndarray) -> NormalEquations:
    """The normal equations of each trial, of samples less what the autoregression (ORDER,) foresees of them."""
    q = found[0].regressors.shape[1]
    normal = NormalEquations(np.zeros((trials, q, q)), np.zeros((trials, q)), np.zeros(trials))
    for run in found:
        whole = np.column_stack([run.regressors, run.force, run.course])
        white = whole[ORDER:].copy()
        for k, weight in enumerate(memory, start=1):
            white -= weight * whole[ORDER - k : len(whole) - k]
        slow = qr(white[:, q + 1 :], mode="economic")[0]
        rest = white[:, : q + 1] - slow @ (slow.T @ white[:, : q + 1])
        normal.matrix[run.trial] += rest[:, :q].T @ rest[:, :q]
        normal.vector[run.trial] += rest[:, :q].T @ rest[:, q]
        normal.square[run.trial] += rest[:, q] @ rest[:, q]
    return normal


def memory_of(found: list[Run], numbers: np.ndarray) -> np.ndarray:
    """Autoregression (ORDER,) of the residuals."""
    before, now = [], []
    for run in found:
        rest = run.force - run.regressors @ numbers
        slow = qr(run.course, mode="economic")[0]
        rest -= slow @ (slow.T @ rest)
        before.append(np.column_stack([rest[ORDER - k : len(rest) - k] for k in range(1, ORDER + 1)]))
        now.append(rest[ORDER:])
    past = np.concatenate(before)
    floor = len(past) * SENSORS_N**2 * np.eye(ORDER)
    return np.linalg.solve(past.T @ past + floor, past.T @ np.concatenate(now))


def fit_whitened(found: list[Run], trials: int) -> tuple[NormalEquations, np.ndarray]:
    """Fit the autoregression and the numbers, each by the other; the normal equations and the autoregression."""
    memory = np.zeros(ORDER)
    memory[0] = 0.9
    for _ in range(3):
        memory = memory_of(found, whiten(found, trials, memory).solve(np.ones(trials, bool))[0])
    return whiten(found, trials, memory), memory


def best_delay(delays: np.ndarray, squares: list[float], samples: int) -> float:
    """The delay (samples) at the bottom of a parabola through the least square and its neighbours.

    NaN where the likelihood of the best is not SHARP above that of the shortest and the longest: no delay stands out.
    """
    i = int(np.argmin(squares))
    if 0.5 * samples * np.log(min(squares[0], squares[-1]) / squares[i]) < SHARP:
        return np.nan
    a, b, c = squares[i - 1 : i + 2]
    return float(delays[i] + 0.5 * (a - c) / (a - 2.0 * b + c))


def whitened_across(
    trials: list[Motion], base: dict[str, float], delays: list[tuple[int, int]]
) -> tuple[list[NormalEquations], int]:
    """The normal equations across the path with each pair of a felt and a seen delay (samples), and their samples.

    All are whitened by the autoregression of the middle pair. InputError: no run is long enough.
    """
    found = [across_runs(trials, felt, seen, base["seen_least_m"], base["foresight_s"]) for felt, seen in delays]
    if not found[0]:
        raise InputError("the handle never moved for 0.8 s without a stop, no arm can be fitted")
    memory = fit_whitened(found[len(found) // 2], len(trials))[1]
    return [whiten(runs, len(trials), memory) for runs in found], sum(len(run.force) for run in found[0])


def fit_across(trials: list[Motion], base: dict[str, float], groups: list[np.ndarray]) -> np.ndarray:
    """The numbers of ACROSS (1 + g, 7) from all trials, and without each group of them; delays in s, NaN: not seen.

    base: delays where none is seen, and what is assumed of the seen correction (seen_least_m, foresight_s).
    """
    choices = [np.ones(len(trials), bool), *groups]

    def best_delays(tried: np.ndarray, delays: list[tuple[int, int]]) -> list[float]:
        normals, samples = whitened_across(trials, base, delays)
        return [best_delay(tried, [normal.solve(keep)[1] for normal in normals], samples) for keep in choices]

    usual_felt, usual_seen = (round(base[key] / SAMPLE_S) for key in ("felt_delay_s", "seen_delay_s"))
    felt = usual_felt
    for _ in range(ROUNDS):  # each at the other's best
        before = felt
        seen_delays = best_delays(SEEN, [(felt, delay) for delay in SEEN.tolist()])
        seen = usual_seen if np.isnan(seen_delays[0]) else round(seen_delays[0])
        felt_delays = best_delays(FELT, [(delay, seen) for delay in FELT.tolist()])
        felt = usual_felt if np.isnan(felt_delays[0]) else round(felt_delays[0])
        found = _numbers_across(trials, base, (felt, seen), choices)
        if not found[0, 3] > half_width(found[1:, 3]):  # no felt correction stands out, and so no delay of it
            felt, felt_delays = usual_felt, [np.nan] * len(choices)
            found = _numbers_across(trials, base, (felt, seen), choices)
        if felt == before:
            break
    return np.column_stack([found, SAMPLE_S * np.array(felt_delays), SAMPLE_S * np.array(seen_delays)])


def _numbers_across(
    trials: list[Motion], base: dict[str, float], delays: tuple[int, int], choices: list[np.ndarray]
) -> np.ndarray:
    """The first five numbers of ACROSS (choices, 5), with these delays."""
    (normal,), _ = whitened_across(trials, base, [delays])
    solved = np.array([normal.solve(keep)[0] for keep in choices])
    return np.column_stack([solved[:, :3], solved[:, 3:5] / solved[:, :1]])


def half_width(without: np.ndarray) -> float:
    """Half-width of the 95 % interval of a number, from the numbers (g,) without each of g groups ("jackknife")."""
    g = len(without)
    return float(stats.t.ppf(0.975, g - 1) * np.sqrt((g - 1) / g * np.sum((without - without.mean()) ** 2)))


def fit_along(trials: list[Motion], damping: float, mass: float, groups: list[np.ndarray]) -> np.ndarray:
    """Stiffness along the path (1 + g,), N/m, from all trials, and without each group of them."""
    normal, _ = fit_whitened(along_runs(trials, damping, mass), len(trials))
    return np.array([normal.solve(keep)[0][0] for keep in (np.ones(len(trials), bool), *groups)])


def fit_pace(trials: list[Motion], stiffness: float, damping: float, mass: float) -> np.ndarray:
    """Reaction time (s), movement time (s) and variance of the first (s^2) of each trial without a stall, (m, 3).

    By a minimum-jerk course through the virtual hand that the arm's force shows, before it reacts and from 15 to 90 %
    of the way (in between a handle that stands makes people push harder).
    """
    found = []
    for trial in trials:
        x, length = trial.x[trial.moving, 0], trial.length
        first, last = (int(np.flatnonzero(x < share * length)[-1]) for share in (0.15, 0.9))
        if first >= last or (trial.speed[trial.moving[first:last]] < 2.0 * STALL_M_S).any():
            continue
        push = trial.force[:, 0] + mass * trial.a[:, 0] + damping * trial.v[:, 0]
        hand = (trial.x[:, 0] + push / stiffness)[trial.moving]
        if np.max(hand[first:last] - x[first:last]) > MOST_LEAD_M:
            continue
        samples = np.concatenate([np.arange(15), np.arange(first, last)])
        start = [hand[:15].mean(), 0.25, max(last * SAMPLE_S, 0.4)]
        given = samples, hand[samples], length, damping / stiffness
        fit = least_squares(_missed, start, bounds=([-0.1, 0.0, 0.2], [0.1, 2.0, 60.0]), args=given)
        pull = np.linalg.pinv(fit.jac) * fit.fun  # (3, samples): what each residual does to the numbers
        near = toeplitz(np.maximum(1.0 - np.arange(len(fit.fun)) / CORRELATED, 0.0))  # Newey and West
        found.append([*fit.x[1:], (pull @ near @ pull.T)[1, 1]])
    return np.array(found).reshape(-1, 3)


def _missed(p: np.ndarray, samples: np.ndarray, hand: np.ndarray, length: float, lag_s: float) -> np.ndarray:
    """By how much (m) a minimum-jerk course from p[0] (m) on, after p[1] s and for p[2] s, misses the hand there."""
    course = np.array([minimum_jerk((i * SAMPLE_S - p[1]) / p[2]) for i in samples])
    return p[0] + length * (course[:, 0] + lag_s / p[2] * course[:, 1]) - hand
