"""What the verbs share: how one is added, the devices it names, how its figures are printed."""

import argparse
import json
from collections.abc import Callable

from core.files import InputError

#: How a key ends -> its unit; longer ends first: they hold shorter ones.
UNITS = {"N_s_m": "N s/m", "N_m": "N m", "s": "s", "m": "m", "N": "N", "A": "A", "J": "J"}
DEFAULT_DEVICES = ["three-brake", "four-brake"]


def add_verb(verbs, name: str, do: Callable[[argparse.Namespace], int], says: str, more: str, example: str):
    verb = verbs.add_parser(
        name,
        help=says,
        description=f"{says[0].upper()}{says[1:]}.\n\n{more}",
        epilog=f"example:\n  {example}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    verb.set_defaults(do=do, verb=name)
    return verb


def add_devices(verb: argparse.ArgumentParser) -> None:
    verb.add_argument(
        "--device",
        nargs="+",
        action="extend",
        metavar="NAME|PATH",
        help=f"shipped devices by name, or device files by path (default: {' '.join(DEFAULT_DEVICES)})",
    )


def devices_of(args: argparse.Namespace) -> list:
    from core.device import load_device

    devices = [load_device(device) for device in args.device or DEFAULT_DEVICES]
    names = [device.name for device in devices]
    if len(set(names)) < len(names):
        raise InputError(f"--device: two devices have the same name ({', '.join(names)})")
    return devices


def whole_number_of(at_least: int) -> Callable[[str], int]:
    def whole_number(text: str) -> int:
        if not text.isascii() or not text.isdecimal() or int(text) < at_least:
            raise argparse.ArgumentTypeError(f"must be a whole number of at least {at_least}, not {text!r}")
        return int(text)

    return whole_number


def label(text: str) -> str:
    if not (text.isascii() and text.isalnum()):
        raise argparse.ArgumentTypeError(f"must be letters and digits only, not {text!r}")
    return text


def print_summary(summary: dict, as_json: bool) -> None:
    if as_json:
        print(json.dumps(summary))
    else:
        listed = {key: value for key, value in summary.items() if key != "warnings"}
        width = max((len(in_words(key)) for key in listed), default=0)
        for key, value in listed.items():
            shown = f"{value:.4g}" if isinstance(value, float) else value
            print(f"{in_words(key):{width}}  {shown}")
        for warning in summary.get("warnings", []):  # last, where they are seen
            print(f"warning: {warning}")


def in_words(key: str) -> str:
    """The key of a summary to be read: low_gain_N_s_m is "low gain (N s/m)"."""
    unit = next((unit for unit in UNITS if key.endswith(f"_{unit}")), "")
    name = key.removesuffix(f"_{unit}").replace("_", " ") if unit else key.replace("_", " ")
    return f"{name} ({UNITS[unit]})" if unit else name
