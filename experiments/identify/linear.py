"""Weighted least squares with intervals, and the weights from the residuals' own scatter."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import stats
from scipy.optimize import minimize_scalar

Array = npt.NDArray[np.float64]

CONFIDENCE = 0.95
#: Relative. A singular value below this share of the largest is zero; so is scatter below this share of the values.
ZERO = 1e-9


class LinearFit(NamedTuple):
    """Numbers in the order of the rows of `contrasts`."""

    coefficients: Array  # (p,)
    values: Array  # (q,) contrasts @ coefficients
    half_widths: Array  # (q,) of their 95 % intervals
    fitted: Array  # (n,)
    residuals: Array  # (n,) value - fitted


def undetermined(design: Array, names: Sequence[str]) -> list[str]:
    """The coefficients (of p names) that values with this design (n, p) leave open.

    All of them where there are no more values than coefficients: an exact fit does not show how far to trust it.
    """
    if not len(design):
        return list(names)
    scale = np.max(np.abs(design), axis=0)
    _, singular, right = np.linalg.svd(design / np.where(scale > 0.0, scale, 1.0))
    rank = int(np.sum(singular > ZERO * singular[0]))
    loose = np.any(np.abs(right[rank:]) > np.sqrt(ZERO), axis=0)
    if not np.any(loose) and len(design) <= len(names):
        return list(names)
    return [name for name, bad in zip(names, loose, strict=True) if bad]


def fit_linear(design: Array, values: Array, weights: Array, contrasts: Array | None = None) -> LinearFit:
    """Minimise sum of weights * (values - design @ coefficients)^2; design (n, p), values and weights (n,).

    The residuals give the common factor of the weights. Their ratios may be a little wrong: each interval rests on
    the larger of two deviations, one that trusts them and one from the values' own residuals over their leverage
    ("HC2"). contrasts (q, p): what to report, by default each coefficient. `undetermined` must have named none.
    """
    contrasts = np.eye(design.shape[1]) if contrasts is None else contrasts
    root = np.sqrt(weights)
    x = design * root[:, None]
    inverse = np.linalg.pinv(x)  # (p, n)
    coefficients = inverse @ (values * root)
    fitted = design @ coefficients
    residuals = values - fitted
    squares = (residuals * root) ** 2
    freedom = len(values) - design.shape[1]
    kept = np.maximum(1.0 - np.einsum("ij,ji->i", x, inverse), ZERO)
    pull = (contrasts @ inverse) ** 2
    variance = np.maximum(np.sum(pull, axis=1) * np.sum(squares) / freedom, pull @ (squares / kept))
    half_widths = stats.t.ppf(0.5 + CONFIDENCE / 2.0, freedom) * np.sqrt(variance)
    return LinearFit(coefficients, contrasts @ coefficients, half_widths, fitted, residuals)


TURNS = 30  # of the weights and the fit, each by the other


def variance_by_group(design: Array, values: Array, groups: npt.NDArray[np.int_]) -> Array:
    """(m,) variance of the values in each group, from the residuals of the fit that weights them by it.

    Each group's sum of squares is divided by its size less its share of the coefficients. groups: 0 .. m - 1.
    """
    variance = np.ones(int(groups.max()) + 1)
    smallest = (ZERO * float(np.max(np.abs(values)))) ** 2
    for _ in range(TURNS):
        root = 1.0 / np.sqrt(variance)[groups]
        x = design * root[:, None]
        inverse = np.linalg.pinv(x)
        residuals = values - design @ (inverse @ (values * root))
        freedom = np.bincount(groups, 1.0 - np.einsum("ij,ji->i", x, inverse))
        squares = np.bincount(groups, residuals**2)
        pooled = np.sum(squares) / np.sum(freedom)
        own = freedom > 0.5  # with less the group has no scatter of its own
        variance = np.maximum(np.where(own, squares / np.where(own, freedom, 1.0), pooled), smallest)
    return variance


def weights_with_ripple(design: Array, values: Array, weights: Array, speed: Array) -> Array:
    """(n,) weights / (1 + (speed / s)^2), with the s that makes the residuals likeliest (restricted likelihood).

    Scatter that has a constant part, and one of ripple that grows with the speed (n,) of the shaft.
    """

    def scaled(log_s: float) -> Array:
        return weights / (1.0 + (speed / np.exp(log_s)) ** 2)

    def unlikely(log_s: float) -> float:
        root = np.sqrt(scaled(log_s))
        x, y = design * root[:, None], values * root
        q, r = np.linalg.qr(x)
        squares = max(float(np.sum((y - q @ (q.T @ y)) ** 2)), (ZERO * float(np.linalg.norm(y))) ** 2)
        determinants = 2.0 * float(np.sum(np.log(np.abs(np.diag(r))))) - 2.0 * float(np.sum(np.log(root)))
        return (len(y) - x.shape[1]) * np.log(squares) + determinants

    bounds = np.log([np.min(speed) / 8.0, np.max(speed) * 8.0])
    return scaled(minimize_scalar(unlikely, bounds=bounds, method="bounded", options={"xatol": 0.01}).x)
