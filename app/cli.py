"""The command `phd`: one verb a subcommand, each importing only what it needs (Qt: `run`, and `replay` on the screen).

Data on stdout, log and progress on stderr. Exit 0: done; 1: failed; 2: wrong input of any kind, with one sentence.
"""

import argparse
import io
import os
import signal
import sys
from collections.abc import Sequence
from errno import EINVAL
from importlib import import_module
from typing import NoReturn

from app import __version__
from core.files import InputError

DONE, FAILED, WRONG_INPUT, INTERRUPTED, PIPE_CLOSED = 0, 1, 2, 130, 141
#: Modules of app.verbs, each with `add`; in the order of `phd --help`.
VERBS = ("run", "study", "models", "folders", "bench", "machine", "bundle")
#: What the file system refuses because of what was asked for, not because something broke.
WRONG_PATH = (FileNotFoundError, FileExistsError, NotADirectoryError, IsADirectoryError, PermissionError)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one verb; the exit code."""
    if argv is None:
        argv = sys.argv[1:]
        for stream in (sys.stdout, sys.stderr):  # Windows gives files and pipes another encoding
            if isinstance(stream, io.TextIOWrapper):
                stream.reconfigure(encoding="utf-8")
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))  # half-written files are removed
    try:
        args, unknown = make_parser().parse_known_args(with_verb(argv))
        if unknown:
            raise InputError(f"unrecognized arguments: {' '.join(unknown)} (see phd {args.verb} --help)")
        code = args.do(args) or DONE
        sys.stdout.flush()
        return code
    except SystemExit as end:  # --help and --version
        return end.code if isinstance(end.code, int) else DONE
    except InputError as error:
        return _fail(str(error), WRONG_INPUT)
    except KeyboardInterrupt:
        return _fail("interrupted", INTERRUPTED)
    except OSError as error:
        if isinstance(error, BrokenPipeError) or (os.name == "nt" and (error.errno, error.filename) == (EINVAL, None)):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # no reader is left: end quietly
            return PIPE_CLOSED
        place = f"{error.filename}: " if error.filename else ""
        reason = error.strerror or str(error)
        return _fail(f"{place}{reason}", WRONG_INPUT if isinstance(error, WRONG_PATH) else FAILED)
    except FloatingPointError as error:
        return _fail(str(error), FAILED)


def with_verb(argv: Sequence[str]) -> list[str]:
    """The arguments with their verb: options alone are those of `phd run`."""
    if not argv or (argv[0].startswith("-") and argv[0] not in ("-h", "--help", "--version")):
        return ["run", *argv]
    return list(argv)


def _fail(sentence: str, code: int) -> int:
    print("phd:", " ".join(sentence.split()), file=sys.stderr)
    return code


class _Parser(argparse.ArgumentParser):
    """argparse, with its refusals as one sentence."""

    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message} (see {self.prog} --help)")


def make_parser() -> argparse.ArgumentParser:
    """The verbs and their arguments."""
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
