"""The decorators of kernels, `kernel` and `inlined`. numba is imported when the first kernel is called."""

import functools
import os
from collections.abc import Callable
from typing import Any

from core.kernels.cache import PLAIN, cache_folder

#: Without the interpreter lock, division by zero gives inf (no hidden branch). No flag that assumes finite numbers.
#: Without numba's run-time for arrays (_nrt) a kernel that allocates does not compile: that nothing is allocated per
#: tick is checked by the compiler, and arrays cost no reference counting.
_OPTIONS = dict(nopython=True, boundscheck=None, nogil=True, error_model="numpy", _nrt=False)

#: Begins the names of modules that are files of one's own. There an index beyond its array is an error, not a stray
#: write, at the cost of a comparison an index.
OWN_MODULE = "phd_own_"

#: Whether Python runs the kernels as they are, without numba.
INTERPRETED = os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")


class Kernel:
    """A function that is compiled when it is first called."""

    def __init__(self, function: Callable, options: dict[str, Any]) -> None:
        functools.update_wrapper(self, function)
        self.function, self.options = function, options

    @functools.cached_property
    def entry(self) -> Any:
        """numba's dispatcher of the calls from Python."""
        if PLAIN:
            return plain_numba(self.function, self.options)
        from core.kernels.compiler import Entry

        return Entry(self.part, self.options)

    @functools.cached_property
    def part(self) -> Any:
        """numba's dispatcher of the calls from other kernels."""
        if PLAIN:
            return self.entry
        from core.kernels.compiler import Part

        return Part(self.function, self.options)

    @property
    def _numba_type_(self) -> Any:
        """The type that numba gives to a kernel that another one names."""
        from numba.core import types

        return types.Dispatcher(self.part)

    def __call__(self, *arguments: Any) -> Any:
        return self.entry(*arguments)


def plain_numba(function: Callable, options: dict[str, Any]) -> Any:
    """numba's dispatcher without our compiler; its machine code is stored in our folder, so that it is never stale."""
    import numba

    numba.config.SLP_VECTORIZE = 1  # as our compiler has it
    folder = cache_folder()
    numba.config.CACHE_DIR = str(folder or "")
    return numba.jit(cache=folder is not None, **options)(function)


def kernel(function: Any) -> Any:
    """Compile a function, once for each list of argument types; its machine code is stored on disk."""
    options = {**_OPTIONS, "boundscheck": True} if function.__module__.startswith(OWN_MODULE) else _OPTIONS
    return function if INTERPRETED else Kernel(function, options)


def inlined(function: Any) -> Any:
    """Compile a kernel into each caller, as the few small ones are of which a simulated step is made.

    LLVM alone would call them: a call takes longer than most of them do, and a step half as long again.
    """
    return function if INTERPRETED else Kernel(function, {**_OPTIONS, "forceinline": True})
