"""`phd bring-up`: one check after another on a device that has just been wired, with a record that sessions name."""

import argparse
import json
import queue
import sys
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.ipc.scheduling import take_scheduling
from app.progress import watch_compiling
from app.verbs.common import DATA_DIR, add_verb, number_between, print_result
from app.verbs.run import checked_link, port_of
from core.device import load_device
from core.files import InputError
from experiments.inputs import MOUSE
from experiments.protocol import home_of, load_protocol
from experiments.recording.atomic_files import refusing
from hardware.own_driver import own_failure

if TYPE_CHECKING:
    from experiments.bring_up.bring_up import Result
    from experiments.bring_up.step import Step

MARKS = {"passed": "ok", "failed": "NO", "not done": "--"}
EMULATED_S = 3.0  # after which the hand of an emulated board has done what it was ordered. Our choice


def add(verbs: argparse._SubParsersAction) -> None:
    verb = add_verb(
        verbs, "bring-up", bring_up, "check a device that has just been wired, one thing after another\n"
        "Says what to do, what was seen, and where a step fails what to mend. At first no hand is needed and no\n"
        "current flows; later brakes get 10 % of their current, and a hand is asked to the handle last, once\n"
        "watchdog and emergency stop are known to work. Every end (Ctrl+C too) is zero current. A step whose\n"
        "conditions have not passed is not done. The record goes to DATA/bring-up, signed with the name of\n"
        "--by; sessions name it.\n"
        "Exit 0: all passed. Exit 1: something did not.",
        "phd bring-up --link serial:/dev/ttyACM0 --device four-brake --by 'A. Builder'", prints="the record",
    )  # fmt: skip
    verb.set_defaults(input=MOUSE)  # as `port_of` takes it
    option = verb.add_argument
    option(
        "--link", required=True, metavar="serial:PORT|driver:FILE.py",
        help="the board's port (auto: the only one on USB; socket://HOST:NUMBER: a TCP port), or a driver of your own",
    )  # fmt: skip
    option("--force", default="", metavar="netft:HOST", help="an ATI Net F/T in place of the board's force channels")
    option(
        "--device", default="four-brake", metavar="NAME|PATH", help="what the board is wired to (default: four-brake)"
    )
    option(
        "--step", metavar="NAME", help="this step again, with those that it needs; its result goes into the "
        "newest record of the board (default: all steps)",
    )  # fmt: skip
    option("--by", required=True, metavar="NAME", help="who signs the record")
    option("--data-dir", **DATA_DIR)
    option(
        "--latency-s", type=number_between(0.0, 3600.0, "more than 0 and less than 3600 seconds"), default=60.0,
        metavar="S", help="how long latency and jitter are watched (default: 60)",
    )  # fmt: skip


class Printed:
    """Steps and results on stderr."""

    def ask(self, step: "Step") -> None:
        say(f"\n    {step.title}")
        if step.ask:
            say(f"    {step.ask}{' Then press Enter.' if step.confirmed else ''}")

    def show(self, result: "Result") -> None:
        from experiments.bring_up.record import state_of

        if not result.done:
            say(f"\n    {result.step.title}")
        say(f"{MARKS[state_of(result)]}  {result.finding.saw}")
        if result.finding.advice:
            say(f"    {result.finding.advice}")


class AtTheKeyboard(Printed):
    """Enter says that it is done."""

    def __init__(self) -> None:
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._keyboard = threading.Thread(target=self._read, name="keyboard", daemon=True)
        self._keyboard.start()

    def _read(self) -> None:
        for line in sys.stdin or ():  # None: the program was started without one
            self._lines.put(line)

    def ask(self, step: "Step") -> None:
        super().ask(step)
        while not self._lines.empty():  # typed before it was asked
            self._lines.get()

    def is_ready(self) -> bool:
        if not self._keyboard.is_alive() and self._lines.empty():
            raise InputError("standard input has ended: nobody can say here that a step is done")
        return not self._lines.empty()


class EmulatedBuilder(Printed):
    """Lets the hand of an emulated board do what is asked."""

    def __init__(self, control: int) -> None:
        """control: the UDP port that takes orders."""
        self._control, self._done_s = control, 0.0

    def ask(self, step: "Step") -> None:
        from hardware.emulated_board.plug import give_order

        super().ask(step)
        if step.order and "error" in (answer := give_order(self._control, step.order)):
            raise InputError(f"--link: the emulated board's hand is no builder's ({answer['error']}): start the board "
                             "by phd emulate --hand builder")  # fmt: skip
        self._done_s = time.perf_counter() + EMULATED_S

    def is_ready(self) -> bool:
        return time.perf_counter() >= self._done_s


def say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def bring_up(args: argparse.Namespace) -> int:
    from experiments.bring_up.bring_up import BringUp
    from experiments.bring_up.record import brake_steps, make_record, record_to_amend, write_record
    from experiments.bring_up.steps import steps_for, with_needs
    from experiments.session.journal import now
    from hardware.emulated_board.plug import emulated_ports
    from hardware.serial_device import device_at

    if not args.by.strip():
        raise InputError("--by: must be the name of who signs the record")
    device = load_device(args.device)
    link = checked_link(link_port(args), args.force)
    make_folder(args.data_dir)
    watch_compiling()
    home = home_of(device, load_protocol().paths)
    real = device_at(device, link)
    take_scheduling()  # as a control loop's: the board's watchdog trips after 50 ms
    real.open()  # from now on it must hear something each second
    results: list[Result] = []
    about: dict[str, Any] = {}
    try:
        control = emulated_ports().get(real.port)
        builder = AtTheKeyboard() if control is None else EmulatedBuilder(control)
        steps = steps_for(device, real.encoders, real.force_channels > 0, home, args.latency_s)
        before = None
        if args.step is not None:
            steps, before = with_needs(steps, args.step), record_to_amend(args.data_dir, device, real.report())
        say(f"{device.name} at {real.port}: {len(steps)} steps. Ctrl+C ends it at any time, with zero current.")
        runner = BringUp(real, builder)
        for _ in runner.run(steps):
            pass
        results = runner.results
        about = real.report()
    finally:
        broken = own_failure(real)
        real.close()
        if not broken and own_failure(real):
            say(f"{own_failure(real)}: the device is not closed; make sure that no brake has current")
    if broken:
        raise InputError(f"{broken}; no record is written")
    record = make_record(results, device, about, args.by, now(), before)
    try:
        files = write_record(args.data_dir, record, brake_steps(results))
    except (InputError, OSError):
        print(json.dumps(record))  # what cannot be written is not lost
        raise
    print_result(args, record, "\n".join([f"{verdict_on(record['steps'])}; signed by {args.by}", *map(str, files)]))
    return 0 if record["passed"] else 1


def verdict_on(steps: list[dict[str, Any]]) -> str:
    """The steps that failed or were not done, in a line; else "all passed"."""
    names = {state: [step["name"] for step in steps if step["state"] == state] for state in ("failed", "not done")}
    return "; ".join(f"{state}: {', '.join(which)}" for state, which in names.items() if which) or "all passed"


def link_port(args: argparse.Namespace) -> str:
    """The port of --link. InputError: it names no real device."""
    if not (port := port_of(args)):
        raise InputError(
            "--link: must be serial:PORT, socket://HOST:NUMBER or driver:FILE.py: only a real device is brought up"
        )
    return port


def make_folder(data_dir: Path) -> None:
    """InputError before anything is done, rather than after ten minutes."""
    from experiments.bring_up.record import FOLDER

    for folder in (data_dir, data_dir / FOLDER):
        with refusing(folder, "cannot be used"):
            folder.mkdir(parents=True, exist_ok=True)
