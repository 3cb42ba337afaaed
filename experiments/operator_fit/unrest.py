"""The tremor and noise of a hand that holds a handle at rest, where its force is no answer to a motion.

The force of each 0.4 s at rest (with what the arm takes of it), less a cubic (the hand's slow corrections), is normal
with the covariance of the operator model: noise of share x force behind a low-pass, and a tremor of some rms, frequency
and width.
"""

import numpy as np
from scipy.linalg import eigh, qr, toeplitz
from scipy.optimize import minimize

from core.tick_log import TICK_S
from experiments.operator_fit.arm import runs
from experiments.operator_fit.motions import STRIDE, Motion, kernel

PIECE = 40  # samples
REST_M_S = 0.002  # our choice: a slower handle rests
START = {"noise_share": 0.03, "tremor_N": 0.15, "tremor_Hz": 8.0, "tremor_band_Hz": 1.5}
BOUNDS = np.log([(1e-3, 1.0), (1e-3, 20.0), (3.0, 20.0), (0.1, 10.0)])
LEAST_PIECES = 10


def pieces_at_rest(trials: list[Motion], arm: dict[str, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The pieces at rest before the movement: hand's own force (s, PIECE, 2), N, its level (s,), N, and trial (s,)."""
    pieces, levels, owners = [], [], []
    stiffness = np.array([arm["stiffness_along_N_m"], arm["stiffness_across_N_m"]])
    for number, trial in enumerate(trials):
        own = trial.force + stiffness * trial.x + arm["damping_N_s_m"] * trial.v + arm["mass_kg"] * trial.a
        rests = trial.waiting & (trial.speed < REST_M_S)
        for start, end in runs(rests):
            for i in range(start, end - PIECE + 1, PIECE):
                pieces.append(own[i : i + PIECE])
                levels.append(np.hypot(*trial.force[i : i + PIECE].mean(axis=0)))
                owners.append(number)
    return np.array(pieces), np.array(levels), np.array(owners)


def covariance(lags: np.ndarray) -> np.ndarray:
    """Covariance (PIECE, PIECE) of the smoothed samples of a signal with the autocovariance `lags` (n,) of ticks."""
    weights = np.correlate(kernel(), kernel(), "full")
    reach = len(weights) // 2
    apart = STRIDE * np.arange(PIECE)[:, None] + np.arange(-reach, reach + 1)[None, :]
    return toeplitz(lags[np.abs(apart)] @ weights)


def resonance(frequency: float, width: float, n: int) -> np.ndarray:
    """Autocovariance (n,) of the operator's tremor at unit variance: x = 2 r cos(w) x_1 - r^2 x_2 + draw."""
    radius, angle = np.exp(-np.pi * width * TICK_S), 2.0 * np.pi * frequency * TICK_S
    first = 2.0 * radius * np.cos(angle) / (1.0 + radius**2)
    k = np.arange(n)
    return radius**k * (np.cos(angle * k) + (first / radius - np.cos(angle)) / np.sin(angle) * np.sin(angle * k))


def fit_unrest(trials: list[Motion], arm: dict[str, float], corner_Hz: float) -> dict[str, tuple[float, float]]:
    """Name -> number and standard error of its logarithm, by likelihood; empty where the hand hardly rested.

    The errors are by the likelihood's curvature and the scatter from trial to trial ("sandwich"). corner_Hz: of the
    noise, which these pieces do not show.
    """
    force, levels, owners = pieces_at_rest(trials, arm)
    if len(force) < LEAST_PIECES:
        return {}
    cubic = np.vander(np.linspace(-1.0, 1.0, PIECE), 4)
    free = qr(cubic)[0][:, 4:]
    rest = np.einsum("nk,sna->sak", free, force)
    n = STRIDE * PIECE + len(kernel())
    noise = free.T @ covariance(np.exp(-2.0 * np.pi * corner_Hz * TICK_S * np.arange(n))) @ free

    def unlikely(logs: np.ndarray) -> np.ndarray:
        """Minus the logarithm of the likelihood of each piece (s,)."""
        share, rms, frequency, width = np.exp(np.clip(logs, *BOUNDS.T))
        tremor = free.T @ covariance(resonance(frequency, width, n)) @ free
        ratio, turn = eigh(noise, tremor)
        variance = (share * levels[:, None, None]) ** 2 * ratio + rms**2
        outside = np.sum((logs - np.clip(logs, *BOUNDS.T)) ** 2)
        likelihood = 0.5 * np.sum(np.log(variance) + (rest @ turn) ** 2 / variance, axis=(1, 2))
        return likelihood + np.linalg.slogdet(tremor)[1] + outside

    start = np.log(list(START.values()))
    near = {"xatol": 1e-3, "fatol": 1e-2}
    best = minimize(lambda p: np.sum(unlikely(p)), start, method="Nelder-Mead", options=near).x
    step = 0.02 * np.eye(len(best))
    scores = np.array([unlikely(best + h) - unlikely(best - h) for h in step]).T / 0.04  # (s, 4)
    by_trial = np.array([scores[owners == trial].sum(axis=0) for trial in np.unique(owners)])
    bend = np.array([[np.sum(unlikely(best + g + h) - unlikely(best + g - h) - unlikely(best - g + h)
                             + unlikely(best - g - h)) for h in step] for g in step]) / 0.04**2  # fmt: skip
    inverse = np.linalg.pinv(bend)
    errors = np.sqrt(np.diag(inverse @ by_trial.T @ by_trial @ inverse))
    return {name: (float(np.exp(log)), float(error)) for name, log, error in zip(START, best, errors, strict=True)}
