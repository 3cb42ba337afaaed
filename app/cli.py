"""The command `phd`: one verb a subcommand, each importing only what it needs (no verb but `run` touches Qt).

Data on stdout, log and progress on stderr. Exit 0: done; 1: failed; 2: wrong input of any kind, with one sentence.
"""

import argparse
import json
import os
import signal
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import NoReturn

from app import __version__
from app.progress import Progress, announce_first_use
from core.errors import InputError

DONE, FAILED, WRONG_INPUT, INTERRUPTED, PIPE_CLOSED = 0, 1, 2, 130, 141
DEFAULT_DEVICES = ["three-brake", "four-brake"]
#: What the file system refuses because of what was asked for, not because something broke.
WRONG_PATH = (FileNotFoundError, FileExistsError, NotADirectoryError, IsADirectoryError, PermissionError)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one verb; the exit code."""
    if argv is None:
        argv = sys.argv[1:]
        signal.signal(
            signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM)
        )  # let half-written files be removed
    try:
        args = make_parser().parse_args(list(argv) or ["run"])
        code = args.do(args)
        sys.stdout.flush()
        return code
    except SystemExit as end:  # --help and --version
        return end.code if isinstance(end.code, int) else DONE
    except InputError as error:
        return _say(str(error), WRONG_INPUT)
    except KeyboardInterrupt:
        return _say("interrupted", INTERRUPTED)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # nobody reads on: end quietly
        return PIPE_CLOSED
    except OSError as error:
        place = f"{error.filename}: " if error.filename else ""
        reason = error.strerror or str(error)
        return _say(f"{place}{reason}", WRONG_INPUT if isinstance(error, WRONG_PATH) else FAILED)
    except FloatingPointError as error:
        return _say(str(error), FAILED)


def _say(sentence: str, code: int) -> int:
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
        description="A passive haptic display you can run an experiment on: with or without the five-bar.",
        epilog="phd alone opens the app. Every verb explains itself: phd simulate --help",
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"phd {__version__}")
    verbs = parser.add_subparsers(title="verbs", metavar="VERB", required=True)
    _add_run(verbs)
    _add_study(verbs)
    _add_simulate(verbs)
    _add_analyze(verbs)
    return parser


def _add_verb(verbs, name: str, do: Callable[[argparse.Namespace], int], says: str, more: str, example: str):
    verb = verbs.add_parser(
        name,
        help=says,
        description=f"{says[0].upper()}{says[1:]}.\n\n{more}",
        epilog=f"example:\n  {example}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    verb.set_defaults(do=do)
    return verb


def _add_devices(verb: argparse.ArgumentParser) -> None:
    verb.add_argument(
        "--device",
        nargs="+",
        action="extend",
        metavar="NAME|PATH",
        help=f"shipped devices by name, or device files by path (default: {' '.join(DEFAULT_DEVICES)})",
    )


def _devices(args: argparse.Namespace) -> list:
    from core.device import load_device

    devices = [load_device(device) for device in args.device or DEFAULT_DEVICES]
    names = [device.name for device in devices]
    if len(set(names)) < len(names):
        raise InputError(f"--device: two devices have the same name ({', '.join(names)})")
    return devices


def _whole_number(at_least: int) -> Callable[[str], int]:
    def whole_number(text: str) -> int:
        if not text.isascii() or not text.isdecimal() or int(text) < at_least:
            raise argparse.ArgumentTypeError(f"must be a whole number of at least {at_least}, not {text!r}")
        return int(text)

    return whole_number


def _label(text: str) -> str:
    if not (text.isascii() and text.isalnum()):
        raise argparse.ArgumentTypeError(f"must be letters and digits only, not {text!r}")
    return text


def _add_run(verbs) -> None:
    verb = _add_verb(
        verbs,
        "run",
        _run,
        "open the app and run trials (the same as phd alone)",
        "The simulated device is moved with the mouse: the pointer pulls the handle on a spring.",
        "phd run --device three-brake --participant 01 --data-dir data",
    )
    _add_devices(verb)
    verb.add_argument("--participant", type=_label, default="01", metavar="01", help="who moves the handle")
    verb.add_argument(
        "--data-dir",
        type=Path,
        default=Path("data"),
        metavar="DIR",
        help="where sessions are kept (default: data)",
    )


def _run(args: argparse.Namespace) -> int:
    args.devices = _devices(args)
    try:
        from app import window
    except ImportError as error:
        if ".so" not in str(error):
            raise
        raise InputError(f"the window cannot be opened, a system library is missing: {error}") from None
    return window.run(args) or DONE


def _add_study(verbs) -> None:
    verb = _add_verb(
        verbs,
        "study",
        _study,
        "run the paper's whole study with simulated operators",
        "Per operator: 2 segments x 2 devices x 5 controllers x 3 trials. Leaves recordings, trials.csv,\n"
        "box plots and statistics. The same seed gives the same trials.csv.",
        "phd study --operators 3 --seed 1 --out study-1",
    )
    verb.add_argument("--operators", type=_whole_number(1), default=3, metavar="N", help="how many (default: 3)")
    verb.add_argument(
        "--seed", type=_whole_number(0), default=1, metavar="N", help="of everything random (default: 1)"
    )
    _add_devices(verb)
    verb.add_argument(
        "--rules",
        choices=("settled", "literal"),
        default="settled",
        help="rule set of the controllers (default: settled)",
    )
    verb.add_argument(
        "--low-gain",
        choices=("5", "500"),
        default="5",
        help="N s/m of controller 5: 5 as the paper's Table I prints it, or 500 (default: 5)",
    )
    verb.add_argument("--out", type=Path, required=True, metavar="DIR", help="a new or empty folder")
    verb.add_argument("--json", action="store_true", help="print the summary as JSON")


def _study(args: argparse.Namespace) -> int:
    devices = _devices(args)
    from experiments.study import run_study

    announce_first_use()
    with Progress("study") as progress:
        summary = run_study(
            args.out,
            operators=args.operators,
            seed=args.seed,
            devices=devices,
            rules=args.rules,
            low_gain=float(args.low_gain),
            progress=progress,
        )
    _print_summary(summary, args.json)
    return DONE


def _add_simulate(verbs) -> None:
    verb = _add_verb(
        verbs,
        "simulate",
        _simulate,
        "simulate one scene without an operator",
        "A scene file names a device, a brake schedule and a hand force; the motion goes to a CSV file.",
        "phd simulate scene.toml --out motion.csv",
    )
    verb.add_argument("scene", type=Path, metavar="SCENE.toml", help="the scene file")
    verb.add_argument("--out", type=Path, required=True, metavar="FILE.csv", help="a new file")
    verb.add_argument("--json", action="store_true", help="print the summary as JSON")


def _simulate(args: argparse.Namespace) -> int:
    from experiments.scene import read_scene

    scene = read_scene(args.scene)
    from experiments.simulate import open_scene, simulate

    def announced(scene):
        announce_first_use()
        return open_scene(scene)

    with Progress("simulating") as progress:
        summary = asdict(simulate(scene, args.out, announced, progress))
    if args.json:
        told = {"device": scene.device.name, "assumed": scene.device.assumed, "fidelity": scene.fidelity}
        _print_summary(told | {"integrator": scene.integrator} | summary, True)
    else:
        assumed = " (assumed)" if scene.device.assumed else ""
        print(
            f"{args.out}: {summary['rows']} rows, device {scene.device.name}{assumed}, "
            f"{summary['simulated_s']:g} s simulated in {summary['wall_s']:.3g} s: {summary['steps']} steps, "
            f"{summary['events']} events, {summary['fallbacks']} fallbacks"
        )
    return DONE


def _add_analyze(verbs) -> None:
    verb = _add_verb(
        verbs,
        "analyze",
        _analyze,
        "rebuild every number and figure of a study from its recordings alone",
        "Writes into a new folder; never touches the files of DIR.",
        "phd analyze study-1 --out study-1-again",
    )
    verb.add_argument("dir", type=Path, metavar="DIR", help="a folder that phd study or phd run has written")
    verb.add_argument("--out", type=Path, metavar="OUT", help="a new folder (default: DIR/analysis-N)")
    verb.add_argument("--json", action="store_true", help="print the summary as JSON")


def _analyze(args: argparse.Namespace) -> int:
    from experiments.analyze import analyze

    with Progress("analyzing") as progress:
        summary = analyze(args.dir, args.out, progress=progress)
    _print_summary(summary, args.json)
    return DONE


def _print_summary(summary: dict, as_json: bool) -> None:
    if as_json:
        print(json.dumps(summary))
    else:
        width = max(map(len, summary), default=0)
        for key, value in summary.items():
            print(
                f"{key.replace('_', ' '):{width}}  {value:.4g}"
                if isinstance(value, float)
                else f"{key:{width}}  {value}"
            )


if __name__ == "__main__":
    sys.exit(main())
