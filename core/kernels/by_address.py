"""Kernels that others call by their address: each is compiled alone, after the kernels that call it.

A `Caller` has the argument types of a sample. Its `address_of` compiles a kernel for them; a kernel then calls it as
`caller(address, *arguments)`. Without numba an address is a number under which the function is found.

An address holds in one process alone. There it stays valid: the kernels are kept here, and numba frees no machine code
(`JITCPUCodegen._add_module`).
"""

import functools
import itertools
from collections.abc import Callable
from typing import Any

from core.kernels.decorators import INTERPRETED

_kept: dict[int, Callable] = {}  # by their addresses: so that their machine code stays
#: The result of a call by address if the kernel raised an error.
FAILED = -1
_numbers = itertools.count(1)


class Caller:
    """Calls a kernel by its address, from a kernel or from Python. Its result is an np.int64; `FAILED` if it raises."""

    def __init__(self, sample: Callable[[], tuple]) -> None:
        """sample: returns arguments of the types of every call; called when the first kernel is compiled."""
        self._sample = sample

    def __reduce__(self) -> tuple:
        """Pickled as a part of the key of a kernel on disk, without the intrinsic."""
        return Caller, (self._sample,)

    def address_of(self, kernel: Any) -> int:
        """The address of a kernel's machine code in this process. numba's errors if it does not compile."""
        if INTERPRETED:
            address = next(_numbers)
        else:
            kernel.entry.compile(self._types)
            (compiled,) = kernel.entry.overloads.values()
            address = compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name)
        _kept.setdefault(address, kernel)
        return address

    def __call__(self, address: int, *arguments: Any) -> int:
        """The call without numba."""
        kernel = _kept[address]
        try:
            return kernel(*arguments)
        except Exception:  # any error, as where it is compiled
            return FAILED

    @functools.cached_property
    def _types(self) -> tuple:
        from numba import typeof

        return tuple(map(typeof, self._sample()))

    @functools.cached_property
    def _numba_type_(self) -> Any:
        """The type that numba gives to a caller that a kernel names: that of an intrinsic."""
        from numba.core.registry import cpu_target

        call = _intrinsic(self._types)
        cpu_target.typing_context.refresh()  # numba learns of an intrinsic when it next looks
        return cpu_target.typing_context.resolve_value_type(call)


def _alike(given: Any, expected: Any) -> bool:
    """Whether values of two types have the same layout in memory; an array in a record may be read-only or not."""
    from numba.core import types as known

    types: Any = known  # for mypy: numba defines the names at run time
    if isinstance(given, types.BaseTuple) and isinstance(expected, types.BaseTuple):
        same = getattr(given, "instance_class", None) is getattr(expected, "instance_class", None)
        return same and len(given) == len(expected) and all(map(_alike, given, expected))
    if isinstance(given, types.Array) and isinstance(expected, types.Array):
        return (given.dtype, given.ndim, given.layout) == (expected.dtype, expected.ndim, expected.layout)
    return given == expected


def _intrinsic(expected: tuple) -> Any:
    from llvmlite import ir
    from numba.core import types as known
    from numba.core.errors import TypingError
    from numba.extending import intrinsic

    types: Any = known

    @intrinsic
    def call(typing, address, *arguments):
        (packed,) = arguments if len(arguments) == 1 else (arguments,)
        if not _alike(types.Tuple(tuple(packed)), types.Tuple(expected)):  # or it would read other numbers than given
            raise TypingError(f"a call by address takes {expected}, not {tuple(packed)}")

        def generate(context, builder, signature, values):
            at, together = values
            convention = context.call_conv
            function = builder.inttoptr(at, ir.PointerType(convention.get_function_type(types.int64, expected)))
            apart = [builder.extract_value(together, place) for place in range(len(expected))]
            status, result = convention.call_function(builder, function, types.int64, expected, apart)
            return builder.select(status.is_error, result.type(FAILED), result)

        return types.int64(address, types.StarArgTuple(tuple(packed))), generate

    return call
