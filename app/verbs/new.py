"""The verbs that begin: `phd new` makes the folder of an experiment, `phd completion` teaches a shell the verbs."""

import argparse
import re
from pathlib import Path

import shtab

from app.progress import watch_compiling
from app.verbs.common import add_verb, print_result, summary_text
from core.control.own_file import read_own
from core.device import SHIPPED_FOLDER, shipped_devices
from core.files import InputError
from experiments.atomic_files import make_empty_folder, write_new_files
from experiments.protocol import read_code

TEMPLATES = Path(__file__).with_name("new_experiment")
DEVICE = "my-device"
SHELLS = ("bash", "zsh", "tcsh")


def add(verbs: argparse._SubParsersAction) -> None:
    option = add_verb(
        verbs, "new", new_verb, "make a folder with an experiment of your own to start from\n"
        "A protocol, a device file and a page that says how to go on. The device begins as a copy of a shipped one.",
        "phd new my-experiment",
    ).add_argument  # fmt: skip
    option("dir", type=Path, metavar="DIR", help="new or empty folder")
    option("--device", default="three-brake", metavar="NAME", help="shipped device to copy (default: three-brake)")
    option = add_verb(
        verbs, "check-controller", check_controller_verb, "check a controller of your own: energy, currents, numbers\n"
        "Simulated people move with it along the paper's paths on shipped devices: does it never add energy, are its\n"
        "currents within limits, every number finite, its decisions declared and repeatable? Exit 1: a check failed.",
        "phd check-controller damper.py --set damping_N_s_m=300", prints="what was found",
    ).add_argument  # fmt: skip
    option("file", type=Path, metavar="FILE.py", help="the controller")
    option("--set", action="append", default=[], metavar="NAME=NUMBER", help="value of a parameter; repeatable")
    option = add_verb(
        verbs, "completion", completion_verb, "print a completion script for your shell\n"
        "bash: phd completion bash >> ~/.bashrc; zsh: phd completion zsh > a folder of $fpath, as _phd.",
        "phd completion bash",
    ).add_argument  # fmt: skip
    option("shell", choices=SHELLS, help="your shell")


def new_verb(args: argparse.Namespace) -> None:
    if args.device not in (shipped := shipped_devices()):
        raise InputError(f"--device: {args.device!r} is no shipped device: choose one of {', '.join(shipped)}")
    text = (SHIPPED_FOLDER / f"{args.device}.toml").read_text(encoding="utf-8")
    device = re.sub(r'(?m)^name = ".*"$', f'name = "{DEVICE}"', text, count=1)
    files = {path.name: path.read_bytes() for path in TEMPLATES.iterdir() if path.suffix != ".py"}
    files[f"{DEVICE}.toml"] = device.encode()
    make_empty_folder(args.dir, "an experiment begins in a new or empty folder")
    write_new_files({args.dir / name: content for name, content in files.items()})
    print(f"{args.dir}: begin with {args.dir / 'README.md'}")


def check_controller_verb(args: argparse.Namespace) -> int:
    from experiments.study.controller_check import check_controller

    given = dict(map(_setting, args.set))
    text = read_code(args.file.parent, args.file.name)
    watch_compiling()
    found = check_controller(read_own(args.file.stem, text), given)
    print_result(args, found, summary_text(found))
    return 1 if found["failed"] else 0


def _setting(text: str) -> tuple[str, float]:
    name, _, number = text.partition("=")
    try:
        return name, float(number)
    except ValueError:
        raise InputError(f"--set: must be NAME=NUMBER, not {text!r}") from None


def completion_verb(args: argparse.Namespace) -> None:
    from app.cli import make_parser  # it imports this module

    print(shtab.complete(make_parser(), shell=args.shell))
