"""Kernels without scipy: numba imports it only to see whether there is a BLAS, and our kernels need none."""

import sys


def spare_scipy() -> None:
    """Before the first kernel runs: a fifth of a second less. scipy can be imported afterwards as ever."""
    if "scipy.linalg" in sys.modules:
        return
    scipy = sys.modules.get("scipy")
    sys.modules["scipy"] = None  # type: ignore[assignment]
    try:
        import numba.np.arraymath  # noqa: F401  (it asks once)
    finally:
        del sys.modules["scipy"]
        if scipy is not None:
            sys.modules["scipy"] = scipy
