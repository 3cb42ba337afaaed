"""How kernels become machine code; nothing outside this folder knows numba's insides.

`decorators` marks a kernel, `compiler` makes machine code of it, `cache` keeps that on disk. With PHD_PLAIN_NUMBA=1
`compiler` is left out and `numba.jit` does its work: the same numbers, later (docs/decisions/05-kernel-cache.md).
"""

from core.kernels.decorators import INTERPRETED, inlined, kernel

__all__ = ["INTERPRETED", "inlined", "kernel"]
