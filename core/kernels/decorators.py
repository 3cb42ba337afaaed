"""The decorators of every kernel; numba is imported when the first kernel is called."""

import functools
import os
from collections.abc import Callable
from typing import Any

from core.kernels.cache import PLAIN, cache_folder

#: Without the interpreter lock, division by zero gives inf (no hidden branch). No flag that assumes finite numbers.
#: Without numba's run-time for arrays (_nrt) a kernel that allocates does not compile: that nothing is allocated per
#: tick is checked by the compiler, and arrays cost no reference counting.
_OPTIONS = dict(nopython=True, boundscheck=None, nogil=True, error_model="numpy", _nrt=False)

#: How the names of modules begin that are files of one's own: there an index beyond its array is an error, not a stray
#: write. It costs them a comparison an index.
OWN_MODULE = "phd_own_"

#: Left to Python without the jit.
INTERPRETED = os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")


class Kernel:
    """A function that is compiled when it is first called; numba is imported then, not with the module of a kernel."""

    def __init__(self, function: Callable, options: dict[str, Any]) -> None:
        functools.update_wrapper(self, function)
        self.function, self.options = function, options

    @functools.cached_property
    def entry(self) -> Any:
        """The dispatcher that numba calls."""
        import numba

        # LLVM may do the same arithmetic on several numbers at once, which numba leaves out: a tick takes a tenth less.
        # Each number is rounded as before.
        numba.config.SLP_VECTORIZE = 1
        if PLAIN:
            return plain_numba(self.function, self.options)
        from core.kernels.compiler import Entry

        return Entry(self.function, self.options)

    @property
    def _numba_type_(self) -> Any:
        """The type by which numba knows a kernel that another names."""
        from numba.core import types

        return types.Dispatcher(self.entry)

    def __call__(self, *arguments: Any) -> Any:
        return self.entry(*arguments)


def plain_numba(function: Callable, options: dict[str, Any]) -> Any:
    """A kernel without our compiler; numba keeps it in the same folder, so that it is never stale."""
    import numba

    folder = cache_folder()
    numba.config.CACHE_DIR = str(folder or "")
    return numba.jit(cache=folder is not None, **options)(function)


def kernel(function: Any) -> Any:
    """Compile a function: once for each types of its arguments, kept on disk."""
    options = {**_OPTIONS, "boundscheck": True} if function.__module__.startswith(OWN_MODULE) else _OPTIONS
    return function if INTERPRETED else Kernel(function, options)


def inlined(function: Any) -> Any:
    """Compile a kernel always into its caller: the few small ones of which a step is made.

    A call costs more than most of them do; the compiler by itself leaves them out of line and a step takes half as
    long again.
    """
    return function if INTERPRETED else Kernel(function, {**_OPTIONS, "forceinline": True})
