"""Calls of a kernel by its address: one that was compiled alone, after all that calls it.

`address_of` compiles a kernel for the types of its arguments; `call_at` calls it. Interpreted, an address is a number
under which the function is found.
"""

import itertools
from collections.abc import Callable
from typing import Any

from core.kernels.decorators import INTERPRETED

_functions: dict[int, Callable] = {}  # interpreted; compiled: those whose machine code must stay
_numbers = itertools.count(1)


def address_of(kernel: Any, arguments: tuple) -> int:
    """Where the machine code of a kernel for arguments of these types begins, in this process; it answers an np.int64.

    numba's errors if it does not compile.
    """
    if INTERPRETED:
        number = next(_numbers)
        _functions[number] = kernel
        return number
    from numba import typeof

    types = tuple(map(typeof, arguments))
    kernel.entry.compile(types)
    (compiled,) = kernel.entry.overloads.values()  # a kernel of its own for each address
    address = compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name)
    _functions[address] = kernel
    return address


def _call_interpreted(address: int, *arguments: Any) -> int:
    return _functions[address](*arguments)


def _intrinsic() -> Any:
    from llvmlite import ir
    from numba.core import cgutils, types
    from numba.extending import intrinsic

    @intrinsic
    def call(typing, address, *arguments):  # noqa: ANN001, ANN202
        given = arguments[0] if len(arguments) == 1 and isinstance(arguments[0], types.BaseTuple) else arguments
        parts = tuple(given)

        def generate(context, builder, signature, values):  # noqa: ANN001, ANN202
            at, packed = values
            convention = context.call_conv
            kind = convention.get_function_type(types.int64, parts)
            function = builder.inttoptr(at, ir.PointerType(kind))
            unpacked = [builder.extract_value(packed, i) for i in range(len(parts))]
            status, result = convention.call_function(builder, function, types.int64, parts, unpacked)
            with cgutils.if_unlikely(builder, status.is_error):
                convention.return_status_propagate(builder, status)
            return result

        return types.int64(address, types.StarArgTuple(parts)), generate

    return call


call_at = _call_interpreted if INTERPRETED else _intrinsic()
