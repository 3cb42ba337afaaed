"""The verbs on recordings: `phd replay` one; `phd analyze`, `phd export`, `phd verify` a folder."""

import argparse
import getpass
from pathlib import Path

from app.progress import ScreenCheck, import_window_module
from app.verbs.common import (
    FIGURES,
    FOLDER,
    RUN_OWN_CODE,
    add_verb,
    ask_own_code,
    print_result,
    summary_text,
    with_progress,
)
from core.files import InputError
from core.own_consent import OPTION
from experiments.numbers import percent
from experiments.protocol_file import Export

#: Any of these: no window.
HEADLESS = ("controller", "device", "out", "json")


def add(verbs: argparse._SubParsersAction) -> None:
    option = add_verb(
        verbs, "replay", replay_verb,
        "play a recorded trial on the screen, or simulate its hand with another controller or device\n"
        "With any of the options below no window opens: the hand of the trial's movement is simulated once more, and\n"
        "each metric is printed before and after. A person would react to what they feel; the recorded hand\n"
        "only gives way as an arm does. With neither --controller nor --device it is the recorded trial again, to the\n"
        "last bit; a warning names where it is not (another version or machine recorded it).",
        "phd replay study-1/sub-01/ses-01/trials/run-001.parquet --controller 3 --out replayed.csv",
        prints="the summary",
    ).add_argument  # fmt: skip
    option("recording", type=Path, metavar="RECORDING", help="a recording in its session's folder")
    controller = "name or number of a controller of the protocol (default: the recorded one)"
    option("--controller", metavar="CONTROLLER", help=controller)
    option("--device", metavar="NAME|PATH", help="shipped name or device file (default: the recorded one)")
    option("--out", type=Path, metavar="FILE.csv", help="new file for the simulated ticks")
    option(OPTION, **RUN_OWN_CODE)
    option = add_verb(
        verbs, "analyze", analyze_verb, "rebuild every number and figure of a study from its recordings alone\n"
        "Writes into a new folder; never touches the files of DIR. A recording that is damaged is left out and named,\n"
        "with the change of each box against the rows of DIR; the exit code is still 0 (phd verify exits 1).\n"
        "The journals in DIR are read for what no recording holds: trials skipped or done again later.",
        "phd analyze study-1 --out study-1-again", prints="the summary",
    ).add_argument  # fmt: skip
    option("dir", **FOLDER)
    option("--out", type=Path, metavar="OUT", help="new folder (default: DIR/analysis-N)")
    option(
        "--unblind", action="store_true",
        help="reveal the controllers of blind sessions; their journals record who did it, and when",
    )  # fmt: skip
    option(
        "--beside", type=Path, nargs="+", default=[], metavar="DIR",
        help="further studies, compared in OUT/side-by-side.md",
    )  # fmt: skip
    option("--figures", **FIGURES)
    timeouts = "include trials that ran out of time in boxes and statistics"
    option("--timeouts", action="store_true", help=timeouts)
    option(OPTION, **RUN_OWN_CODE)
    option = add_verb(
        verbs, "export", export_verb, "write a study's recordings as BIDS-Motion or as CSV\n"
        "Each into a new folder, whole or not at all; both may be asked for at once. A recording that is damaged or\n"
        "was cut off is left out and named. While a session is blind, controllers keep their codes and what the\n"
        "brakes did is not exported. Answers to the questionnaire go into both, the experimenter's notes into CSV.",
        "phd export study-1 --bids study-1-bids", prints="the summary",
    ).add_argument  # fmt: skip
    option("dir", **FOLDER)
    option("--bids", type=Path, metavar="OUT", help="new or empty folder for a BIDS-Motion data set")
    option("--csv", type=Path, metavar="OUT", help="new or empty folder for trials.csv and each recording as CSV")
    compress = "write the recordings as .csv.gz, a third of the size"
    option("--compress", action="store_true", help=compress)
    shift = "BIDS: move the dates before 1925, by a random number of days for each participant"
    option("--shift-dates", action="store_true", help=shift)
    author = "BIDS: an author, kept for the next export; repeatable (default: the protocol's, else those kept)"
    option("--author", action="append", default=[], metavar="NAME", help=author)
    licence = "BIDS: its licence, such as CC0-1.0 (kept, and with the same default, as --author)"
    option("--licence", "--license", default="", metavar="NAME", help=licence)
    option = add_verb(
        verbs, "verify", verify_verb,
        "check that nothing in a folder was changed or lost, and that every recording is whole\n"
        "Writes nothing. Exit 0: it is so, or a recording is marked as recovered (an unfinished plan is no fault).\n"
        "Exit 1: each recording that is missing, damaged or was cut off, each row of a database that was changed or\n"
        "is missing, each folder that is a copy, and each table that is stale is named, with what makes it again.\n"
        "Checksums find accidents, not malice.",
        "phd verify study-1", prints="what was found",
    ).add_argument  # fmt: skip
    option("dir", **FOLDER)


def analyze_verb(args: argparse.Namespace) -> None:
    from experiments.analysis.chart_figures import SCREEN
    from experiments.study.analyze import analyze, read_studies, write_side_by_side

    ask_own_code(args.dir, args.run_own_code)
    studies = read_studies([args.dir, *args.beside]) if args.beside else {}
    unblinded_by = getpass.getuser() if args.unblind else ""
    summary = with_progress(
        "analyzing", analyze, args.dir, args.out, unblinded_by, args.timeouts, args.figures or SCREEN
    )
    if studies:
        summary["side_by_side"] = str(write_side_by_side(studies, Path(summary["out"])))
    print_result(args, summary, summary_text(summary))


def export_verb(args: argparse.Namespace) -> None:
    outs = {form: out for form, out in (("bids", args.bids), ("csv", args.csv)) if out is not None}
    if not outs:
        raise InputError("export: nothing to write, give --bids OUT or --csv OUT (see phd export --help)")
    if args.compress and args.csv is None:
        raise InputError("--compress: is for --csv OUT; BIDS has its recordings uncompressed")
    if args.shift_dates and (args.bids is None or args.csv is not None):
        raise InputError("--shift-dates: is for --bids OUT alone; CSV has the dates as they were")
    if (args.author or args.licence) and args.bids is None:
        raise InputError("--author and --licence: are for --bids OUT")
    from experiments.export.bids import AS_PROTOCOLS_SAY, BidsOptions
    from experiments.export.export import export

    said = Export(authors=tuple(args.author), license=args.licence)
    options = BidsOptions(args.shift_dates, said, kept_of_exports(said)) if args.bids else AS_PROTOCOLS_SAY
    summary = with_progress("exporting", export, args.dir, outs, args.compress, options)
    print_result(args, summary, summary_text(summary))


def kept_of_exports(said: Export) -> Export:
    """What was said of earlier data sets, and is now, from the settings; nothing where they cannot be read."""
    try:
        memory = import_window_module("widgets.memory")
    except InputError:  # a library of the window is missing, which this verb does not need
        return said
    memory.begin()
    for key, value in ((memory.AUTHORS, "\n".join(said.authors)), (memory.LICENCE, said.license)):
        if value:
            memory.remember(key, value)
    return Export(tuple(memory.remembered(memory.AUTHORS).splitlines()), memory.remembered(memory.LICENCE))


def verify_verb(args: argparse.Namespace) -> int:
    from experiments.store.verify import verify

    found = with_progress("verifying", verify, args.dir)
    doubts = found["warnings"]
    text = summary_text(found | {"in_doubt": len(doubts), "warnings": []})
    print_result(
        args, found, text, [*_warn_if_empty(found), *(f"{doubt['file']}: {doubt['warning']}" for doubt in doubts)]
    )
    return 1 if found["faults"] else 0


def replay_verb(args: argparse.Namespace) -> int | None:
    if not any(getattr(args, name) for name in HEADLESS):
        return play(args.recording)
    from experiments.study.replay import Replacement, replay

    ask_own_code(args.recording.absolute().parent.parent, args.run_own_code)
    other = Replacement(args.controller, args.device)
    summary = with_progress("replaying", replay, args.recording, other, args.out, compiles=True)
    print_result(args, summary, table(summary), (f"{args.recording}: {warning}" for warning in summary["warnings"]))
    return None


def play(recording: Path) -> int:
    from experiments.study.playback import read_playback

    read_playback(recording)  # InputError: it cannot be played
    display = ScreenCheck("play it on", "--json needs none")
    trial_window = import_window_module("analyse.trial_window")
    memory = import_window_module("widgets.memory")
    memory.begin()
    display.check(memory.scale())
    return trial_window.run(recording)


def table(summary: dict) -> str:
    """The summary as a table."""
    before, after = summary["before"], summary["after"]
    assumed = ", device numbers assumed" if summary["assumed"] and "assumed" not in summary["note"] else ""
    lines = [
        f"{summary['recording']}: participant {summary['participant']}, {summary['trial']}, hand: {summary['hand']}",
        summary["note"] + assumed,
    ]

    def row(name: str, then: str, now: str, change: str = "") -> None:
        lines.append(f"{name:32}{then:>28}{now:>28}{change:>12}".rstrip())

    row("", "recorded", "replayed", "change")
    for name in ("device", "controller", "status"):
        row(name, before[name], after[name])
    row("way made", percent(before["way_made"], 1), percent(after["way_made"], 1))
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
    return "-" if value is None else f"{value:.4g}"


def share(metric: dict[str, float | None]) -> str:
    """The change of a metric in percent; its difference where it was 0."""
    before, change = metric["before"], metric["change"]
    if change is None or before is None:
        return "-"
    return f"{100.0 * change / abs(before):+.1f} %" if before else f"{change:+.4g}"


def _warn_if_empty(summary: dict) -> list[str]:
    """An empty folder is no fault, but perhaps the wrong folder."""
    return [] if summary["sessions"] else [f"{summary['dir']}: holds no session yet"]
