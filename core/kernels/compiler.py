"""Machine code of those kernels alone that Python calls, each with all kernels that it calls inside.

numba makes machine code of every kernel, with all that it calls: of two hundred kernels that call each other, LLVM
optimises the smallest a dozen times. Here a kernel is

    a part      to the kernels that call it: its own code in LLVM's intermediate form, and no further
    an entry    to Python: the parts of the kernel and of all that it calls, linked and optimised once, as machine code

Both are stored on disk (`core.kernels.cache`). A call from Python looks for the entry there; else it links the parts;
a part that is not there either is compiled by numba, which in turn asks for the parts that it calls:

    Entry.compile -> EntryCache.load_overload | EntryCompiler.compile_extra -> Part.compile, link
    Part.compile  -> PartCache.load_overload  | PartCompiler (numba's)      -> Part.get_call_template of each callee

This uses private classes of numba (libraries, dispatchers): constraints.txt pins the version. How to do without it:
docs/decisions/05-kernel-cache.md.
"""

import functools
import hashlib
import pickle
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
from llvmlite import binding
from numba.core import compiler
from numba.core.codegen import JITCodeLibrary
from numba.core.registry import CPUDispatcher
from numba.core.serialize import dumps
from numba.core.types.misc import unliteral
from numba.core.types.npytypes import Record

from core.kernels.cache import LINKING, cache_folder, read_file, watchers, write_file

#: LLVM may do the same arithmetic on several numbers at once, which numba leaves out: a trial takes 5 % less time. Each
#: number is rounded as before.
numba.config.SLP_VECTORIZE = 1


class _Progress:
    """How many kernels of an entry are compiled, here or by another process."""

    done = of = 0

    @classmethod
    def compiling(cls, name: str) -> None:
        """A kernel of this name begins."""
        cls.done += 1
        cls.of = max(cls.of, cls.done)  # one compiled for other types before is compiled for these, too
        cls.tell(cls.done, name)

    @classmethod
    def tell(cls, number: int, name: str) -> None:
        for watcher in watchers:
            watcher(number, cls.of, name)


def _record_symbol(record: Record) -> tuple:
    """How symbols name a record type: by its fields. numba's own number differs between processes that share parts."""
    return "Record", (int(hashlib.sha256(str(record).encode()).hexdigest()[:12], 16),)


Record.mangling_args = property(_record_symbol)  # type: ignore[assignment, method-assign]


class PartLibrary(JITCodeLibrary):
    """The intermediate code of one kernel, and the libraries of the kernels that it calls.

    The methods of this class that it does not call itself are called by numba.
    """

    part: "Part"
    argument_types: tuple

    @classmethod
    def from_code(cls, codegen: Any, name: str, bitcode: bytes) -> "PartLibrary":
        """The library of this code."""
        library = cls(codegen, name)
        library._final_module = binding.parse_bitcode(bitcode)
        return library

    def add_llvm_module(self, ll_module: Any) -> None:
        self._optimize_functions(ll_module)  # without it dead addresses stay, with which a part cannot be stored
        self._final_module.link_in(ll_module)

    def add_linking_library(self, library: Any) -> None:
        self._linking_libraries.append(library)

    def finalize(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True

    def _get_module_for_linking(self) -> Any:
        self._ensure_finalized()
        return self._final_module

    def with_callees(self) -> list[JITCodeLibrary]:
        """This library and those of all that it calls, however indirectly."""
        found: dict[JITCodeLibrary, None] = {}  # as a set that keeps its order
        waiting: list[JITCodeLibrary] = [self]
        while waiting:
            library = waiting.pop()
            if library not in found:
                found[library] = None
                if isinstance(library, PartLibrary):  # what numba compiles for itself holds its callees
                    waiting += library._linking_libraries
        return list(found)


class EntryLibrary(JITCodeLibrary):
    """The machine code of an entry. The parts linked into it are its own, so LLVM may inline or drop each."""

    called_from_outside: tuple[str, ...] = ()

    def _optimize_final_module(self) -> None:
        for function in self._final_module.functions:
            if function.is_declaration and function.name.startswith("_ZN"):  # a kernel would be called at address 0
                raise RuntimeError(f"{self.name}: calls {function.name}, which is not linked")
            if not function.is_declaration and function.name not in self.called_from_outside:
                function.linkage = "internal"
        super()._optimize_final_module()


class PartCompiler(compiler.Compiler):
    """numba's compiler, as far as the intermediate code."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.state.flags.no_compile = True

    def define_pipelines(self) -> list:
        state = self.state
        _Progress.compiling(state.func_id.func_name)
        state.func_id.unique_id = identity(state.func_id.func)  # numba's own numbers are those of one process
        state.library = PartLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        return super().define_pipelines()


def names_of(function: Callable) -> dict[str, Any]:
    """What the code of a function names, by name: globals, and the cells of its closure."""
    code = function.__code__
    cells = [cell.cell_contents for cell in function.__closure__ or ()]
    return {name: function.__globals__.get(name) for name in code.co_names} | dict(
        zip(code.co_freevars, cells, strict=True)
    )


def is_kernel(value: Any) -> bool:
    """Whether a value is a `Kernel` of `decorators`, which imports this file and so cannot be imported here."""
    return hasattr(type(value), "part")


@functools.cache
def identity(function: Callable) -> str:
    """A hash of a kernel's place and code, and of the kernels and numbers that it names: the same in every process.

    The kernel's own file does not tell two versions apart: what it names may stand in another file, which may be edited
    while a process runs.
    """
    code, named = function.__code__, names_of(function)
    known: list = [function.__module__, function.__qualname__, code.co_code.hex()]
    for value in named.values():
        if is_kernel(value):
            known += [identity(value.function)] if value.function is not function else []
    cells = [named[name] for name in code.co_freevars]
    known += [repr(value) for value in cells if not is_kernel(value)]
    known += [repr(value) for value in (*code.co_consts, *named.values()) if isinstance(value, int | float | tuple)]
    return hashlib.sha256(repr(known).encode()).hexdigest()[:16]


@functools.cache
def _file_hash(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


class EntryCache:
    """The files of an entry: one for each list of argument types, named by these and by all that its code depends on.

    It stands in place of numba's cache, which numbers its files in an index (two processes that compile at once may
    give theirs the same number, and one is then served the other's code) and unpickles whatever it finds.
    """

    kind = ""

    def __init__(self, function: Callable) -> None:
        self.function = function
        code, module = function.__code__, Path(function.__code__.co_filename)
        name = f"{module.stem}.{function.__qualname__}".replace("<", "").replace(">", "")
        python = f"py{sys.version_info[0]}{sys.version_info[1]}{getattr(sys, 'abiflags', '')}"
        self._stamp = _file_hash(module)
        self._folder = module.parent.name
        self._name = f"{name}{self.kind}-{code.co_firstlineno}.{python}"

    def _file(self, signature: Any, target: Any) -> Path | None:
        """The file for these types; None: there is no cache folder."""
        key = numba.__version__, self._stamp, signature, target.codegen().magic_tuple(), identity(self.function)
        folder, digest = cache_folder(), hashlib.sha256(repr(key).encode()).hexdigest()[:16]
        return folder and folder / self._folder / f"{self._name}.{digest}.kernel"

    def save_overload(self, sig: Any, cres: Any) -> None:
        """Called by numba once it has compiled. Code that holds addresses is not stored: another process has others."""
        file = self._file(sig, cres.target_context)
        if file is not None and not cres.library.has_dynamic_globals:
            write_file(file, dumps(self.reduced(cres)))

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Called by numba before it compiles: the stored result; None: there is none."""
        target_context.refresh()
        file = self._file(sig, target_context)
        stored = read_file(file) if file is not None else None
        return None if stored is None else self.rebuilt(target_context, pickle.loads(stored))

    def reduced(self, result: Any) -> Any:
        """A compile result as it is stored."""
        return result._reduce()

    def rebuilt(self, target: Any, stored: Any) -> Any:
        """The compile result again."""
        return compiler.CompileResult._rebuild(target, *stored)


class PartCache(EntryCache):
    """The files of a part: its intermediate code, and which parts it calls."""

    kind = ".part"

    def __init__(self, part: "Part") -> None:
        super().__init__(part.py_func)
        self.part = part

    def reduced(self, result: Any) -> Any:
        """The code, the parts that it calls (by name and argument types), and numba's description of it."""
        names = {part: name for name, part in self.part.called().items()}
        callees: list[tuple] = []
        for library in result.library._linking_libraries:
            if isinstance(library, PartLibrary):
                callees.append((names[library.part], library.argument_types))
            else:  # what numba compiles for itself
                callees.append((None, (library.name, library._get_module_for_linking().as_bitcode())))
        code = result.library.name, result.library._final_module.as_bitcode()
        described = result.fndesc, result.environment, result.signature
        return code, callees, described, result.reload_init, result._find_referenced_environments()

    def rebuilt(self, target: Any, stored: Any) -> Any:
        """The part again, with the libraries of the parts that it calls."""
        _Progress.done += 1  # another process has compiled it
        code, callees, (description, environment, types), reload_init, environments = stored
        library = PartLibrary.from_code(target.codegen(), *code)
        called = self.part.called()
        for name, callee in callees:
            if name is not None:
                called[name].compile(callee)
                library.add_linking_library(called[name].overloads[callee].library)
            else:
                library.add_linking_library(PartLibrary.from_code(target.codegen(), *callee))
        library.finalize()
        return compiler.compile_result(
            typing_context=self.part.typingctx, target_context=target, library=library, environment=environment,
            fndesc=description, signature=types, objectmode=False, lifted=(), entry_point=(description.mangled_name,),
            reload_init=reload_init, referenced_envs=environments, metadata={},
        )  # fmt: skip


class Part(CPUDispatcher):
    """A kernel as other kernels call it. numba calls its methods where it compiles one of those."""

    def __init__(self, function: Callable, options: dict) -> None:
        options = {**options, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
        super().__init__(function, targetoptions=options, pipeline_class=PartCompiler)
        self._cache = PartCache(self)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """The types of a call. A constant argument is a number like others, not a type of its own."""
        named = {name: unliteral(argument) for name, argument in kws.items()}
        return super().get_call_template(tuple(map(unliteral, args)), named)

    def add_overload(self, result: Any) -> None:
        """Take up a compile result."""
        key = (result.fndesc.mangled_name,)
        result.fndesc.typemap = result.fndesc.calltypes = None  # large, and needed no more
        result.library.part, result.library.argument_types = self, tuple(result.signature.args)
        self.targetctx.insert_user_function(key, result.fndesc, [result.library])
        self.overloads[tuple(result.signature.args)] = result._replace(entry_point=key, type_annotation=None)

    def called(self) -> dict[str, "Part"]:
        """The parts of the kernels that this one calls, by the name that it calls them."""
        return {name: value.part for name, value in names_of(self.py_func).items() if is_kernel(value)}

    def not_compiled(self) -> set["Part"]:
        """Of this part and all that it calls, however indirectly, those that are not compiled yet."""
        found: set[Part] = set()
        waiting = [self]
        while waiting:
            part = waiting.pop()
            if part not in found and not part.overloads:
                found.add(part)
                waiting += part.called().values()
        return found


class EntryCompiler:
    """Links a part with all that it calls into one library of machine code, in place of numba's compiler."""

    def __init__(self, part: Part, *from_numba: Any) -> None:
        _typing, target, _library, args, _return_type, flags, _locals = from_numba
        self.part, self.args, self.flags = part, tuple(args), flags
        self.target = compiler._make_subtarget(target, flags)

    def compile_extra(self, function: Callable) -> Any:
        """Called by numba: the compile result of the entry. function: that of the part."""
        _Progress.done, _Progress.of = 0, len(self.part.not_compiled())
        try:
            self.part.compile(self.args)
            _Progress.tell(_Progress.of, LINKING)
            return self.link(self.part.overloads[self.args])
        finally:
            _Progress.tell(_Progress.of, "")

    def link(self, part: Any) -> Any:
        """The compile result of a part, with machine code that Python can call."""
        codegen = self.target.codegen()
        library = EntryLibrary(codegen, part.fndesc.qualname)
        library.called_from_outside = (part.fndesc.llvm_func_name, part.fndesc.llvm_cpython_wrapper_name)
        library.enable_object_caching()
        for callee in part.library.with_callees():
            library.add_linking_library(callee)
        self.target.create_cpython_wrapper(library, part.fndesc, part.environment, None, self.flags.release_gil)
        entry = self.target.get_executable(library, part.fndesc, part.environment)
        self.target.insert_user_function(entry, part.fndesc, [library])
        result = part._replace(library=library, entry_point=entry, metadata={})
        for environment in result._find_referenced_environments():
            codegen.set_env(environment.env_name, environment)
        return result


class Entry(CPUDispatcher):
    """A kernel as Python calls it."""

    def __init__(self, part: Part, options: dict) -> None:
        super().__init__(part.py_func, targetoptions=options, pipeline_class=functools.partial(EntryCompiler, part))
        self._cache = EntryCache(part.py_func)
