"""The verbs that begin: `phd new` makes the folder of an experiment, `phd completion` teaches a shell the verbs."""

import argparse
import re
from pathlib import Path

from app.verbs.common import add_verb
from core.device import SHIPPED_FOLDER, load_device

TEMPLATES = Path(__file__).with_name("new_experiment")
DEVICE = "my-device"
SHELLS = ("bash", "zsh", "tcsh")


def add(verbs: argparse._SubParsersAction) -> None:
    option = add_verb(
        verbs, "new", new_verb, "make a folder with an experiment of your own to start from\n"
        "A protocol, a device file and a page that says how to go on. The device begins as a copy of a shipped one.",
        "phd new my-experiment",
    ).add_argument  # fmt: skip
    option("dir", type=Path, metavar="DIR", help="a new or empty folder")
    option("--device", default="three-brake", metavar="NAME", help="the shipped device to copy (default: three-brake)")
    option = add_verb(
        verbs, "completion", completion_verb, "print what makes a shell complete the verbs and options of phd\n"
        "bash: phd completion bash >> ~/.bashrc; zsh: phd completion zsh > a folder of $fpath, as _phd.",
        "phd completion bash",
    ).add_argument  # fmt: skip
    option("shell", choices=SHELLS)


def new_verb(args: argparse.Namespace) -> None:
    from experiments.recording.atomic_files import make_empty_folder, write_new_files

    load_device(args.device, SHIPPED_FOLDER)  # InputError: there is none
    shipped = (SHIPPED_FOLDER / f"{args.device}.toml").read_text(encoding="utf-8")
    device = re.sub(r'(?m)^name = ".*"$', f'name = "{DEVICE}"', shipped, count=1)
    make_empty_folder(args.dir, "an experiment begins in a new or empty folder")
    files = {args.dir / path.name: path.read_bytes() for path in TEMPLATES.iterdir() if path.suffix != ".py"}
    write_new_files(files | {args.dir / f"{DEVICE}.toml": device.encode()})
    print(f"{args.dir}: begin with {args.dir / 'README.md'}")


def completion_verb(args: argparse.Namespace) -> None:
    import shtab

    from app.cli import make_parser

    print(shtab.complete(make_parser(), shell=args.shell))
