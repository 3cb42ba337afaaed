"""How kernels are compiled: machine code only for what Python calls.

numba compiles every function by itself, down to machine code, with all that it calls inside: of two hundred kernels
that call each other each is optimised a dozen times. Here a kernel that another kernel calls stops at LLVM's
intermediate code, a *part*; the kernel that Python calls, an *entry*, links its parts once, and is optimised once.
"""

import contextlib
import gc
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from numba.core import compiler, typed_passes, untyped_passes
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler_machinery import PassManager
from numba.core.registry import CPUDispatcher
from numba.core.types.functions import BaseFunction

#: Passes of numba for what no kernel has: closures, `with`, literals that steer the typing, inlined Python, array
#: expressions. A kernel that has them is refused, or the machine code is the same: LLVM drops branches never taken.
NOT_NEEDED = (
    untyped_passes.WithLifting,
    untyped_passes.InlineClosureLikes,
    untyped_passes.RewriteSemanticConstants,
    untyped_passes.DeadBranchPrune,
    untyped_passes.RewriteDynamicRaises,
    untyped_passes.MakeFunctionToJitFunction,
    untyped_passes.InlineInlinables,
    untyped_passes.FindLiterallyCalls,
    untyped_passes.LiteralUnroll,
    untyped_passes.LiteralPropagationSubPipelinePass,
    typed_passes.InlineOverloads,
    typed_passes.NopythonRewrites,
    typed_passes.DumpParforDiagnostics,
)


def remember_call_types() -> None:
    """Let numba work out once what an operator or function gives for some types, not anew at each of a thousand uses.

    It asks some twenty overloads each time, a quarter of the compilation.
    """
    work_out = BaseFunction.get_call_type
    known: dict = {}

    def get_call_type(function: Any, context: Any, args: Any, kws: Any) -> Any:
        if kws:
            return work_out(function, context, args, kws)
        key = function, *(argument._code for argument in args)
        if key not in known:
            known[key] = work_out(function, context, args, kws)
        return known[key]

    BaseFunction.get_call_type = get_call_type


remember_call_types()


@contextlib.contextmanager
def no_garbage_collection() -> Iterator[None]:
    """Python's search for cycles finds nothing in the compiler's millions of objects, and takes a tenth of its time."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


class PartLibrary(JITCodeLibrary):
    """The intermediate code of one kernel, and the libraries of the kernels that it calls."""

    def add_llvm_module(self, ll_module: Any) -> None:
        self._final_module.link_in(ll_module)

    def add_linking_library(self, library: Any) -> None:
        self._linking_libraries.append(library)

    def finalize(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True

    def _get_module_for_linking(self) -> Any:
        self._ensure_finalized()
        return self._final_module

    def with_callees(self) -> list:
        """This library and, once each, those of all that it calls."""
        found: dict = {}
        waiting = [self]
        while waiting:
            library = waiting.pop()
            if library not in found:
                found[library] = None
                if isinstance(library, PartLibrary):
                    waiting += library._linking_libraries
        return list(found)


class PartCompiler(compiler.Compiler):
    """numba's compiler, without machine code."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.state.flags.no_compile = True

    def define_pipelines(self) -> list:
        codegen = self.state.targetctx.codegen()
        self.state.library = PartLibrary(codegen, self.state.func_id.func_qualname)
        build = compiler.DefaultPassBuilder
        passes = PassManager("kernel")
        for stage in (
            build.define_untyped_pipeline,
            build.define_typed_pipeline,
            build.define_nopython_lowering_pipeline,
        ):
            passes.passes += [step for step in stage(self.state).passes if step[0] not in NOT_NEEDED]
        passes.finalize()
        return [passes]


class Part(CPUDispatcher):
    """A kernel as other kernels call it."""

    def add_overload(self, result: Any) -> None:
        key = (result.fndesc.mangled_name,)
        result.fndesc.typemap = result.fndesc.calltypes = None  # needed no more, and large
        self.targetctx.insert_user_function(key, result.fndesc, [result.library])
        self.overloads[tuple(result.signature.args)] = result._replace(entry_point=key, type_annotation=None)


class EntryCompiler:
    """In place of numba's compiler: links the part of a kernel with all that it calls."""

    def __init__(self, part: Part, typing: Any, target: Any, library: Any, args: Any, *rest: Any) -> None:
        self.part, self.args = part, args
        self.flags = rest[1]
        self.target = compiler._make_subtarget(target, self.flags)

    def compile_extra(self, function: Callable) -> Any:
        with no_garbage_collection():
            return self.link()

    def link(self) -> Any:
        self.part.compile(self.args)
        part = self.part.overloads[tuple(self.args)]
        codegen = self.target.codegen()
        library = codegen.create_library(part.fndesc.qualname)
        library.enable_object_caching()
        for callee in part.library.with_callees():
            library.add_linking_library(callee)
        self.target.create_cpython_wrapper(library, part.fndesc, part.environment, None, self.flags.release_gil)
        entry = self.target.get_executable(library, part.fndesc, part.environment)
        result = part._replace(library=library, entry_point=entry, metadata={})
        for environment in result._find_referenced_environments():
            codegen.set_env(environment.env_name, environment)
        self.target.insert_user_function(entry, part.fndesc, [library])
        return result


class Kernel(CPUDispatcher):
    """A kernel as Python calls it."""

    def __init__(self, function: Callable, options: dict) -> None:
        wrapperless = {**options, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
        self.part = Part(function, targetoptions=wrapperless, pipeline_class=PartCompiler)
        super().__init__(function, targetoptions=options, pipeline_class=partial(EntryCompiler, self.part))
        self.enable_caching()

    def get_call_template(self, args: Any, kws: Any) -> Any:
        return self.part.get_call_template(args, kws)

    def get_overload(self, signature: Any) -> Any:
        return self.part.get_overload(signature)
