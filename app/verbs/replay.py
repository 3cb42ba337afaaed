"""`phd replay`: a recorded trial on the screen, or its hand through another controller or device."""

import argparse
import sys
from pathlib import Path

from app.progress import Display, Progress, announce_first_use, import_screen
from app.verbs.common import add_verb, print_summary, whole_number_of
from core.files import InputError

#: Any of these: no window.
HEADLESS = ("controller", "device", "protocol", "hand", "out", "json")


def add(verbs) -> None:
    verb = add_verb(
        verbs,
        "replay",
        replay_verb,
        "play a recorded trial on the screen, or its hand through another controller or device",
        "With any of the options below no window opens: the hand of the trial's movement is simulated once more, and\n"
        "each metric is printed as it was and as it is. A person would react to what they feel; the recorded hand\n"
        "only gives way as an arm does. With neither --controller nor --device it is the recorded trial again, to the\n"
        "last bit; a warning says where it is not (another version or machine recorded it).",
        "phd replay study-1/sub-01/ses-01/trials/run-001.parquet --controller 3 --out replayed.csv",
    )
    verb.add_argument("recording", type=Path, metavar="RECORDING", help="a recording in the folder of its session")
    verb.add_argument(
        "--controller",
        type=whole_number_of(1),
        metavar="N",
        help="through this controller, by its number in the protocol (default: the recorded one)",
    )
    verb.add_argument(
        "--device", metavar="NAME|PATH", help="on this device: a shipped one, or a file (default: the recorded one)"
    )
    verb.add_argument(
        "--protocol",
        metavar="NAME|PATH",
        help="where --controller is looked up, with its rule set (default: the protocol of the recording's session)",
    )
    verb.add_argument(
        "--hand",
        choices=("target", "force"),
        help="target: the arm, pulled by the recorded target (default, where that was recorded); force: the recorded "
        "force, whatever the handle does, and nothing that holds it: small differences grow",
    )
    verb.add_argument("--out", type=Path, metavar="FILE.csv", help="a new file for the replayed ticks")
    verb.add_argument("--json", action="store_true", help="print the summary as JSON")


def replay_verb(args: argparse.Namespace) -> int:
    if not any(getattr(args, name) for name in HEADLESS):
        return play(args.recording)
    from experiments.study.replay import replay

    announce_first_use()
    with Progress("replaying") as progress:
        summary = replay(args.recording, args.controller, args.device, args.protocol, args.hand, args.out, progress)
    for warning in summary["warnings"]:
        print(f"warning: {args.recording}: {warning}", file=sys.stderr)
    if args.json:
        print_summary(summary, True)
    else:
        print(table(summary))
    return 0


def play(recording: Path) -> int:
    """On the screen."""
    from experiments.recording.reader import read_recording

    if not read_recording(recording).rows:
        raise InputError(f"{recording}: there are no ticks to play")
    display = Display("play it on", "--json needs none")
    trial_view = import_screen("trial_view")
    display.check()
    return trial_view.run(recording)


def table(summary: dict) -> str:
    """The summary as people read it."""
    before, after = summary["before"], summary["after"]
    assumed = ", the device's parameters assumed" if summary["assumed"] and "assumed" not in summary["note"] else ""
    lines = [
        f"{summary['recording']}: participant {summary['participant']}, run {summary['run']}, hand: {summary['hand']}",
        summary["note"] + assumed,
        f"{'':32}{'recorded':>28}{'replayed':>28}{'change':>12}",
    ]
    for name in ("device", "controller", "status"):
        lines.append(f"{name:32}{before[name]:>28}{after[name]:>28}")
    lines.append(f"{'way made':32}{before['way_made']:>28.1%}{after['way_made']:>28.1%}")
    for name, metric in summary["metrics"].items():
        lines.append(f"{name:32}{_shown(metric['before']):>28}{_shown(metric['after']):>28}{_change(metric):>12}")
    for name in ("energy_residual_J", "energy_added_max_J"):
        lines.append(f"{name:32}{_shown(before[name]):>28}{_shown(after[name]):>28}")
    lines.append(f"largest difference of the tip: {1e3 * summary['largest_tip_difference_m']:.4g} mm")
    if summary["equal"]:
        lines.append("equal to the recording in every tick and column, to the last bit")
    if decisions := summary["decisions"]:
        same = decisions["decisions"] - decisions["different"]
        lines.append(f"decisions, taken again from the recording alone: {same} of {decisions['decisions']} the same")
    lines.append(summary["says"])
    if summary["out"]:
        lines.append(f"{summary['out']}: {summary['ticks']} ticks")
    return "\n".join(lines)


def _shown(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"


def _change(metric: dict[str, float | None]) -> str:
    before, change = metric["before"], metric["change"]
    if change is None or before is None:
        return "-"
    return f"{100.0 * change / abs(before):+.1f} %" if before else f"{change:+.4g}"
