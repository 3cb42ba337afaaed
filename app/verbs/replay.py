"""`phd replay`: a recorded trial on the screen, or its hand through another controller or device."""

import argparse
from pathlib import Path

from app.progress import Display, import_screen
from app.verbs.common import add_verb, answer, whole_number_of, with_progress
from core.files import InputError

#: Any of these: no window.
HEADLESS = ("controller", "device", "protocol", "hand", "out", "json")


def add(verbs: argparse._SubParsersAction) -> None:
    option = add_verb(
        verbs, "replay", replay_verb,
        "play a recorded trial on the screen, or its hand through another controller or device",
        "With any of the options below no window opens: the hand of the trial's movement is simulated once more, and\n"
        "each metric is printed as it was and as it is. A person would react to what they feel; the recorded hand\n"
        "only gives way as an arm does. With neither --controller nor --device it is the recorded trial again, to the\n"
        "last bit; a warning names where it is not (another version or machine recorded it).",
        "phd replay study-1/sub-01/ses-01/trials/run-001.parquet --controller 3 --out replayed.csv",
        prints="the summary",
    ).add_argument  # fmt: skip
    option("recording", type=Path, metavar="RECORDING", help="a recording in the folder of its session")
    controller = "through this controller, by its number in the protocol (default: the recorded one)"
    option("--controller", type=whole_number_of(1), metavar="N", help=controller)
    option("--device", metavar="NAME|PATH", help="on this device, shipped or a file (default: the recorded one)")
    protocol = "where --controller is looked up, with its rule set (default: the protocol of the recording's session)"
    option("--protocol", metavar="NAME|PATH", help=protocol)
    option(
        "--hand", choices=("target", "force"),
        help="target: the arm, pulled by the recorded target (default, where that was recorded); force: the recorded "
        "force, whatever the handle does, and nothing that holds it: small differences grow",
    )  # fmt: skip
    option("--out", type=Path, metavar="FILE.csv", help="a new file for the replayed ticks")


def replay_verb(args: argparse.Namespace) -> int | None:
    if not any(getattr(args, name) for name in HEADLESS):
        return play(args.recording)
    from experiments.study.replay import replay

    asked = args.recording, args.controller, args.device, args.protocol, args.hand, args.out
    summary = with_progress("replaying", replay, *asked, compiles=True)
    answer(args, summary, table(summary), (f"{args.recording}: {warning}" for warning in summary["warnings"]))
    return None


def play(recording: Path) -> int:
    """Play it on the screen."""
    from experiments.recording.reader import read_recording

    if not read_recording(recording).rows:
        raise InputError(f"{recording}: there are no ticks to play")
    display = Display("play it on", "--json needs none")
    trial_view = import_screen("trial_view")
    display.check()
    return trial_view.run(recording)


def table(summary: dict) -> str:
    """The summary to be read."""
    before, after = summary["before"], summary["after"]
    assumed = ", the device's parameters assumed" if summary["assumed"] and "assumed" not in summary["note"] else ""
    lines = [
        f"{summary['recording']}: participant {summary['participant']}, run {summary['run']}, hand: {summary['hand']}",
        summary["note"] + assumed,
    ]

    def row(name: str, then: str, now: str, change: str = "") -> None:
        lines.append(f"{name:32}{then:>28}{now:>28}{change:>12}".rstrip())

    row("", "recorded", "replayed", "change")
    for name in ("device", "controller", "status"):
        row(name, before[name], after[name])
    row("way made", f"{before['way_made']:.1%}", f"{after['way_made']:.1%}")
    for name, metric in summary["metrics"].items():
        row(name, number(metric["before"]), number(metric["after"]), share(metric))
    for name in ("energy_residual_J", "energy_added_max_J"):
        row(name, number(before[name]), number(after[name]))
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


def number(value: float | None) -> str:
    """A value of the table."""
    return "-" if value is None else f"{value:.4g}"


def share(metric: dict[str, float | None]) -> str:
    """How a metric changed, as a share of what it was where it was not 0."""
    before, change = metric["before"], metric["change"]
    if change is None or before is None:
        return "-"
    return f"{100.0 * change / abs(before):+.1f} %" if before else f"{change:+.4g}"
