"""What the verbs share. A verb is its arguments, one call that does the work, and one result that is printed."""

import argparse
import contextlib
import json
import math
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, TypeVar

from app import DATA
from app.progress import ProgressBar, watch_compiling
from core.device import load_device
from core.files import InputError
from core.own_consent import OPTION
from experiments.assumptions import NO_VIBRATION
from experiments.store.own_code import allow_code, unallowed_code

#: How a key ends -> its unit; longer ends first: they hold shorter ones.
UNITS = {"N_s_m": "N s/m", "N_m": "N m", "s": "s", "m": "m", "N": "N", "A": "A", "J": "J"}
#: Words in the keys of shares (0 .. 1), which are shown in percent.
SHARES = {"share", "done"}
DEFAULT_DEVICES = ["three-brake", "four-brake"]
RULES = ("settled", "literal")

# arguments of several verbs, for `add_argument`
FOLDER: dict[str, Any] = {
    "type": Path, "metavar": "DIR", "help": "a folder that phd study or phd run has written"
}  # fmt: skip
DATA_DIR: dict[str, Any] = {
    "type": Path, "default": DATA, "metavar": "DIR",
    "help": "folder of the sessions (default: phd-data in your home folder)"
}  # fmt: skip
DEVICES: dict[str, Any] = {
    "nargs": "+", "action": "extend", "metavar": "NAME|PATH",
    "help": f"shipped names or device files (default: {' '.join(DEFAULT_DEVICES)})",
}  # fmt: skip
FIGURES: dict[str, Any] = {
    "choices": ("screen", "journal"),
    "help": "size of the box plots: screen (default), or journal, 3.5 and 7 inches wide",
}  # fmt: skip
RUN_OWN_CODE: dict[str, Any] = {
    "action": "store_true", "help": "run the folder's own controllers and measures without asking, now and later"
}  # fmt: skip
PORTS: dict[str, Any] = {
    "action": "append", "default": [], "metavar": "PORT", "help": "look for a board there; repeatable"
}  # fmt: skip

Do = Callable[[argparse.Namespace], int | None]
Result = TypeVar("Result")


def add_verb(
    verbs: argparse._SubParsersAction, name: str, do: Do, about: str, example: str, prints: str = ""
) -> argparse.ArgumentParser:
    """Add a verb. do: runs it and returns the exit code (None: 0). about: its first line is the summary.

    prints: what --json prints as JSON; "": there is no --json.
    """
    summary, _, more = about.partition("\n")
    verb = verbs.add_parser(
        name,
        help=summary,
        description=f"{summary[0].upper()}{summary[1:]}.\n\n{more}",
        epilog=f"example:\n  {example}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    verb.set_defaults(do=do, verb=name, options=verb._option_string_actions)
    if prints:
        verb.add_argument("--json", action="store_true", help=f"print {prints} as JSON")
    return verb


def whole_number_of(at_least: int, at_most: float = math.inf) -> Callable[[str], int]:
    """The type of an argument."""
    wanted = f"from {at_least} to {at_most}" if at_most < math.inf else f"of at least {at_least}"

    def whole_number(text: str) -> int:
        if not text.isascii() or not text.isdecimal() or not at_least <= int(text) <= at_most:
            raise argparse.ArgumentTypeError(f"must be a whole number {wanted}, not {text!r}")
        return int(text)

    return whole_number


def number_between(above: float, below: float, wanted: str) -> Callable[[str], float]:
    """The type of an argument: a number between two others, exclusive; `wanted` describes it in a refusal."""

    def number(text: str) -> float:
        with contextlib.suppress(ValueError):
            if above < (found := float(text)) < below:
                return found
        raise argparse.ArgumentTypeError(f"must be {wanted}, not {text!r}")

    return number


def low_gain(text: str) -> float | str:
    """The type of an argument: a gain (N s/m), or the words of the paper's rule."""
    wanted = f"a number greater than 0, in N s/m, or {NO_VIBRATION!r}"
    return text if text == NO_VIBRATION else number_between(0.0, math.inf, wanted)(text)


def devices_of(args: argparse.Namespace) -> list:
    """The devices of --device. InputError if one cannot be read, or two have one name."""
    devices = [load_device(device) for device in args.device or DEFAULT_DEVICES]
    names = [device.name for device in devices]
    if len(set(names)) < len(names):
        raise InputError(f"--device: two devices have the same name ({', '.join(names)})")
    return devices


def ask_own_code(folder: Path, allowed: bool) -> None:
    """Ask on the terminal whether code out of a folder of sessions may run. allowed: the command line says so.

    Where nobody can be asked it does not run, and a sentence says so.
    """
    code = unallowed_code(folder)
    if not code:
        return
    names = f"{folder} holds code of its own: {', '.join(code)}"
    if not allowed and sys.stdin.isatty() and sys.stderr.isatty():
        print(f"{names}. It can do all that you can do on this computer. Run it? [y/N] ", end="", file=sys.stderr)
        sys.stderr.flush()
        allowed = sys.stdin.readline().strip().lower() in ("y", "yes")
    elif not allowed:
        print(f"warning: {names}. It is not run: nobody can be asked here, and {OPTION} is missing", file=sys.stderr)
    if allowed:
        allow_code(code.values())


def with_progress(doing: str, call: Callable[..., Result], *arguments: object, compiles: bool = False) -> Result:
    """Call a function with a progress bar. compiles: before it, another bar shows the kernels that are compiled."""
    if compiles:
        watch_compiling()
    with contextlib.closing(ProgressBar(doing)) as progress:
        return call(*arguments, progress=progress)


def print_result(args: argparse.Namespace, found: Any, text: str, warnings: Iterable[str] = ()) -> None:
    """Print a result as JSON or as text on stdout, and each warning as a line on stderr."""
    for warning in warnings:
        print(f"warning: {warning}", file=sys.stderr)
    print(json.dumps(found) if args.json else text)


def summary_text(summary: dict) -> str:
    """A summary as text: a line for each key, then the entries of its lists, then the warnings."""
    shown = {key: value for key, value in summary.items() if key != "warnings"}
    names = [*map(label_of_key, shown), *map(label_of_controller, shown.get("controllers", ()))]
    width = max(map(len, names), default=0)
    lines, entries = [], []
    for key, value in shown.items():
        if key == "controllers":
            lines += [f"{label_of_controller(of):{width}}  {_shown('share', of['share_reached'])}" for of in value]
            continue
        name = label_of_key(key)
        if isinstance(value, list):
            entries += [": ".join(entry.values()) if isinstance(entry, dict) else f"{name}: {entry}" for entry in value]
            value = len(value)
        lines.append(f"{name:{width}}  {_shown(key, value)}")
    return "\n".join([*lines, *entries, *(f"warning: {warning}" for warning in summary.get("warnings", []))])


def _shown(key: str, value: object) -> object:
    if isinstance(value, float):
        return f"{100.0 * value:.4g} %" if SHARES.intersection(key.split("_")) else f"{value:.4g}"
    return "none" if value is None else value


def label_of_controller(about: dict) -> str:
    """The label of a controller's line, by its name."""
    return f"share reached, {about['name']}"


def label_of_key(key: str) -> str:
    """low_gain_N_s_m becomes "low gain (N s/m)"."""
    unit = next((unit for unit in UNITS if key.endswith(f"_{unit}")), "")
    name = key.removesuffix(f"_{unit}").replace("_", " ") if unit else key.replace("_", " ")
    return f"{name} ({UNITS[unit]})" if unit else name
