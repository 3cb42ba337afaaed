"""The command `phd`: one verb a subcommand, each importing only what it needs (Qt: `run`, and `replay` on the screen).

Data on stdout, log and progress on stderr. Exit 0: done; 1: failed; 2: wrong input of any kind, with one sentence.
"""

import argparse
import io
import os
import re
import signal
import sys
import tempfile
import traceback
import warnings
from collections.abc import Sequence
from errno import EINVAL, ELOOP, ENAMETOOLONG
from importlib import import_module
from typing import Any, NoReturn

from app import DATA, __version__
from core.files import InputError, StrangeInput, cut, did_you_mean
from core.kernels.cache import tellers

DONE, FAILED, WRONG_INPUT, INTERRUPTED, PIPE_CLOSED = 0, 1, 2, 130, 141
#: Modules of app.verbs, each with `add`; in the order of `phd --help`.
VERBS = ("new", "run", "study", "models", "folders", "bench", "machine")
#: Errors of the file system that mean a wrong path, not a broken disk.
WRONG_PATH = (FileNotFoundError, FileExistsError, NotADirectoryError, IsADirectoryError, PermissionError)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one verb and return the exit code."""
    if argv is None:
        argv = sys.argv[1:]
        open_closed_streams()
        for stream in (sys.stdout, sys.stderr):  # Windows gives files and pipes another encoding
            if isinstance(stream, io.TextIOWrapper):
                stream.reconfigure(encoding="utf-8", errors="backslashreplace")  # a file name may be no text
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))  # half-written files are removed
    tellers[:] = [_say]
    with warnings.catch_warnings():
        tell_strange_input()
        return _run(argv)


def _run(argv: Sequence[str]) -> int:
    try:
        if not DATA.is_absolute():
            raise InputError("this user has no home folder: set HOME to the path of a folder")
        args, unknown = make_parser().parse_known_args(with_verb(argv))
        if unknown:
            guess = did_you_mean(unknown[0], [*args.options, "--version"])
            raise InputError(f"unrecognized arguments: {' '.join(unknown)}{guess} (see phd {args.verb} --help)")
        code = args.do(args) or DONE
        sys.stdout.flush()
        return code
    except SystemExit as end:  # --help and --version
        return end.code if isinstance(end.code, int) else DONE
    except InputError as error:
        return _fail(str(error), WRONG_INPUT)
    except KeyboardInterrupt as interrupt:
        return _fail(str(interrupt) or "interrupted", INTERRUPTED)
    except OSError as error:
        if isinstance(error, BrokenPipeError) or (os.name == "nt" and (error.errno, error.filename) == (EINVAL, None)):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # no reader is left: end quietly
            return PIPE_CLOSED
        place = f"{error.filename}: " if error.filename else ""
        reason = (error.strerror or str(error)).lower()
        is_wrong = isinstance(error, WRONG_PATH) or error.errno in (ELOOP, ENAMETOOLONG)
        return _fail(f"{place}{reason}", WRONG_INPUT if is_wrong else FAILED)
    except FloatingPointError as error:
        return _fail(str(error), FAILED)
    except Exception as error:
        return _fail(internal_error(error), FAILED)


def internal_error(error: Exception) -> str:
    """The sentence for an error that nothing has foreseen; its traceback goes into a new file, for a report."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    reason = " ".join(f"{type(error).__name__}: {error}".split()).removesuffix(": ")
    said = f"internal error in {os.path.basename(last.filename)}, line {last.lineno}: {reason}"
    try:
        with tempfile.NamedTemporaryFile(
            "w", prefix="phd-error-", suffix=".txt", delete=False, encoding="utf-8"
        ) as file:
            traceback.print_exception(error, file=file)
    except OSError:
        return said
    return f"{said}; please report it with {file.name}"


def open_closed_streams() -> None:
    """Open the null device for each standard stream that is closed (phd .. >&-).

    Else the first file that is opened would take its number, and print would write into it.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            stream = open(os.devnull, "w" if number else "r", encoding="utf-8")  # noqa: SIM115
            if stream.fileno() != number:
                os.dup2(stream.fileno(), number)
            if getattr(sys, name) is None:
                setattr(sys, name, stream)


def tell_strange_input() -> None:
    """Print a warning on stderr, once, for each doubtful number in a file."""
    show, said = warnings.showwarning, set[str]()

    def tell(message: Warning | str, category: type[Warning], *about: Any, **more: Any) -> None:
        if not issubclass(category, StrangeInput):
            show(message, category, *about, **more)
        elif str(message) not in said:
            said.add(str(message))
            print(f"warning: {message}", file=sys.stderr)

    warnings.showwarning = tell
    warnings.simplefilter("always", StrangeInput)


def with_verb(argv: Sequence[str]) -> list[str]:
    """Put `run` before options that come without a verb."""
    if not argv or (argv[0].startswith("-") and argv[0] not in ("-h", "--help", "--version")):
        return ["run", *argv]
    return list(argv)


def _fail(sentence: str, code: int) -> int:
    _say(cut(" ".join(sentence.split())))
    return code


def _say(sentence: str) -> None:
    print("phd:", " ".join(sentence.split()), file=sys.stderr)


class _Parser(argparse.ArgumentParser):
    """argparse whose refusals are one sentence."""

    def error(self, message: str) -> NoReturn:
        if choice := re.search(r"invalid choice: '(.*?)' \(choose from (.*)\)", message):
            message += did_you_mean(choice[1], re.findall(r"[\w-]+", choice[2]))
        raise InputError(f"{message} (see {self.prog} --help)")


def make_parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="phd",
        description="A passive haptic display you can run an experiment on: a real one or a simulated one.",
        epilog="phd alone opens the app. Every verb explains itself: phd simulate --help",
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"phd {__version__}")
    verbs = parser.add_subparsers(title="verbs", metavar="VERB", required=True)
    for module in VERBS:
        import_module(f"app.verbs.{module}").add(verbs)
    return parser


if __name__ == "__main__":
    sys.exit(main())
