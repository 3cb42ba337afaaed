"""How kernels become machine code: only those that Python calls, each with all that it calls inside.

numba by itself makes machine code of every function, and optimises all that it calls with it: of two hundred kernels
that call each other, the smallest went through LLVM a dozen times. Here a kernel as other kernels call it is a *part*,
in LLVM's intermediate code and no further. A kernel as Python calls it is an *entry*: its part, linked once with the
parts that it calls, optimised once. Both are kept on disk: a process compiles an entry from the parts that it finds.

This leans on what numba keeps to itself (libraries, dispatchers): constraints.txt pins the version.
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
from numba.core.caching import _Cache
from numba.core.codegen import JITCodeLibrary
from numba.core.registry import CPUDispatcher
from numba.core.serialize import dumps
from numba.core.types.misc import unliteral
from numba.core.types.npytypes import Record

from core.kernels.cache import cache_folder, keep, read_kept, watchers


class _Count:
    """How many of the kernels of an entry are compiled."""

    done = of = 0

    @classmethod
    def compiling(cls, name: str) -> None:
        cls.done += 1
        cls.tell(min(cls.done, cls.of), name)

    @classmethod
    def tell(cls, number: int, name: str) -> None:
        for watcher in watchers:
            watcher(number, cls.of, name)


def name_records_by_their_fields() -> None:
    """Let the symbols of two processes agree: numba names a record type by its number in the process."""

    def mangling_args(record: Record) -> tuple:
        return "Record", (int(hashlib.sha256(str(record).encode()).hexdigest()[:12], 16),)

    Record.mangling_args = property(mangling_args)  # type: ignore[assignment, method-assign]


name_records_by_their_fields()


class PartLibrary(JITCodeLibrary):
    """The intermediate code of one kernel, and the libraries of the kernels that it calls."""

    part: "Part"
    argument_types: tuple

    @classmethod
    def from_code(cls, codegen: Any, name: str, bitcode: bytes) -> "PartLibrary":
        """A library read back from the disk."""
        library = cls(codegen, name)
        library._final_module = binding.parse_bitcode(bitcode)
        return library

    def add_llvm_module(self, ll_module: Any) -> None:
        self._optimize_functions(ll_module)  # one by one, so that what is linked later is small enough to be inlined
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
        """This library and, each once, those of all that it calls, however indirectly."""
        found: dict[JITCodeLibrary, None] = {}
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
            if function.is_declaration and function.name.startswith("_ZN"):  # a kernel: it would be called at address 0
                raise RuntimeError(f"{self.name}: calls {function.name}, which is not linked")
            if not function.is_declaration and function.name not in self.called_from_outside:
                function.linkage = "internal"
        super()._optimize_final_module()


class PartCompiler(compiler.Compiler):
    """numba's compiler as far as the intermediate code."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.state.flags.no_compile = True

    def define_pipelines(self) -> list:
        state = self.state
        _Count.compiling(state.func_id.func_name)
        state.func_id.unique_id = identity(state.func_id.func)  # numba's own numbers are those of one process
        state.library = PartLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        return super().define_pipelines()


def entry_of(value: Any) -> "Entry | None":
    """The entry of a kernel (`core.kernels.decorators.Kernel`); None for any other value."""
    entry = getattr(value, "entry", None)
    return entry if isinstance(entry, Entry) else None


@functools.cache
def identity(function: Callable) -> str:
    """What tells a kernel from all others in every process: its place, its code, and what it names.

    What was kept of a kernel is so not found beside another version of what it calls, or of a number that it uses,
    though its own file is the same (an edit may come while a process runs): it would call what is not linked.
    """
    code = function.__code__
    cells = [cell.cell_contents for cell in function.__closure__ or ()]
    named = [function.__globals__.get(name) for name in code.co_names]
    kernels = [entry.py_func for value in (*cells, *named) if (entry := entry_of(value))]
    known: list = [function.__module__, function.__qualname__, code.co_code.hex()]
    known += [identity(kernel) for kernel in kernels if kernel is not function]
    known += [repr(value) for value in cells if entry_of(value) is None]
    known += [repr(value) for value in (*code.co_consts, *named) if isinstance(value, int | float | tuple)]
    return hashlib.sha256(repr(known).encode()).hexdigest()[:16]


@functools.cache
def _file_hash(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


class EntryCache(_Cache):
    """Keeps an entry on disk: one file for each types of arguments, named by them and by all that its code depends on.

    In place of numba's own, which numbers its files in an index (two processes that compile at once may give theirs the
    same number, and one is then served the other's code) and unpickles whatever it finds.
    """

    kind = ""

    def __init__(self, function: Callable) -> None:
        self.function = function
        code, module = function.__code__, Path(function.__code__.co_filename)
        name = f"{module.stem}.{function.__qualname__}".replace("<", "").replace(">", "")
        python = f"py{sys.version_info[0]}{sys.version_info[1]}{getattr(sys, 'abiflags', '')}"
        place = hashlib.sha256(str(module.parent).encode()).hexdigest()[:16]
        self._stamp = _file_hash(module)
        self._folder = f"{module.parent.name}_{place}"
        self._name = f"{name}{self.kind}-{code.co_firstlineno}.{python}"

    def _file(self, signature: Any, target: Any) -> Path | None:
        """None: nothing is kept."""
        key = numba.__version__, self._stamp, signature, target.codegen().magic_tuple(), identity(self.function)
        folder, digest = cache_folder(), hashlib.sha256(repr(key).encode()).hexdigest()[:16]
        return folder and folder / self._folder / f"{self._name}.{digest}.kernel"

    def save_overload(self, sig: Any, cres: Any) -> None:
        """Called by numba with a compiled function; does not keep addresses, which hold in this process alone."""
        file = self._file(sig, cres.target_context)
        if file is not None and not cres.library.has_dynamic_globals:
            keep(file, dumps(self.reduced(cres)))

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """What numba calls before it compiles; None: it must."""
        target_context.refresh()
        file = self._file(sig, target_context)
        kept = read_kept(file) if file is not None else None
        return None if kept is None else self.rebuilt(target_context, pickle.loads(kept))

    def reduced(self, result: Any) -> Any:
        """What is kept of a compile result."""
        return result._reduce()

    def rebuilt(self, target: Any, kept: Any) -> Any:
        """The compile result again."""
        return compiler.CompileResult._rebuild(target, *kept)

    @property
    def cache_path(self) -> str:
        """As numba asks for it."""
        return str(cache_folder())

    def enable(self) -> None:
        """Do nothing: this cache is always on."""

    disable = flush = enable


class PartCache(EntryCache):
    """Keeps a part on disk: its intermediate code, and which parts it calls."""

    kind = ".part"

    def __init__(self, part: "Part") -> None:
        super().__init__(part.py_func)
        self.part = part

    def reduced(self, result: Any) -> Any:
        """The code, which parts it calls by which name and types, and what numba wants to know of it."""
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

    def rebuilt(self, target: Any, kept: Any) -> Any:
        """The part again, linked with those that it calls."""
        code, callees, (description, environment, types), reload_init, environments = kept
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
    """A kernel as other kernels call it; Python does not."""

    def __init__(self, function: Callable, options: dict) -> None:
        super().__init__(function, targetoptions=options, pipeline_class=PartCompiler)
        self._cache = PartCache(self)

    def add_overload(self, result: Any) -> None:
        key = (result.fndesc.mangled_name,)
        result.fndesc.typemap = result.fndesc.calltypes = None  # large, and needed no more
        result.library.part, result.library.argument_types = self, tuple(result.signature.args)
        self.targetctx.insert_user_function(key, result.fndesc, [result.library])
        self.overloads[tuple(result.signature.args)] = result._replace(entry_point=key, type_annotation=None)

    def called(self) -> dict[str, "Part"]:
        """The parts of the kernels that this one calls, by the name that it calls them."""
        function = self.py_func
        used = {name: function.__globals__.get(name) for name in function.__code__.co_names}
        cells = zip(function.__code__.co_freevars, function.__closure__ or (), strict=True)
        used.update((name, cell.cell_contents) for name, cell in cells)
        return {name: entry.part for name, kernel in used.items() if (entry := entry_of(kernel))}

    def to_compile(self) -> set["Part"]:
        """This part and those of all that it calls, however indirectly, that are not compiled for any types yet."""
        found: set[Part] = set()
        waiting = [self]
        while waiting:
            part = waiting.pop()
            if part not in found and not part.overloads:
                found.add(part)
                waiting += part.called().values()
        return found


class EntryCompiler:
    """Stands where numba expects a compiler: links a part with all that it calls into one library of machine code."""

    def __init__(  # noqa: PLR0913
        self, part: Part, typing: Any, target: Any, library: Any, args: Any, return_type: Any, flags: Any, locals: Any
    ) -> None:
        self.part, self.args, self.flags = part, tuple(args), flags
        self.target = compiler._make_subtarget(target, flags)

    def compile_extra(self, function: Callable) -> Any:
        _Count.done, _Count.of = 0, len(self.part.to_compile())
        self.part.compile(self.args)
        _Count.tell(_Count.of, f"linking {function.__name__}")  # which may take as long as compiling them
        result = self.link(self.part.overloads[self.args])
        _Count.tell(_Count.of, "")
        return result

    def link(self, part: Any) -> Any:
        """The entry: the part's compile result, with machine code that Python can call."""
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
    """A kernel: called by Python it is an entry, kept on disk; called by another kernel it is a part."""

    def __init__(self, function: Callable, options: dict) -> None:
        for_kernels = {**options, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
        self.part = Part(function, for_kernels)
        super().__init__(function, targetoptions=options, pipeline_class=functools.partial(EntryCompiler, self.part))
        self._cache = EntryCache(function)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """What numba asks where another kernel calls; a constant is a number like others, not a type of its own."""
        named = {name: unliteral(argument) for name, argument in kws.items()}
        return self.part.get_call_template(tuple(map(unliteral, args)), named)

    def get_overload(self, signature: Any) -> Any:
        """What numba asks for the call's code."""
        return self.part.get_overload(signature)
