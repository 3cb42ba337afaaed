"""The verbs on a folder of recordings: `phd analyze`, `phd export`, `phd verify`, `phd recover`."""

import argparse
import getpass
from pathlib import Path

from app.verbs.common import FOLDER, add_verb, answer, as_text, with_progress
from core.files import InputError


def add(verbs: argparse._SubParsersAction) -> None:
    option = add_verb(
        verbs, "analyze", analyze_verb, "rebuild every number and figure of a study from its recordings alone",
        "Writes into a new folder; never touches the files of DIR. A recording that is damaged is left out and named,\n"
        "with the change of each box against the trials.csv of DIR; the exit code is still 0 (phd verify exits 1).\n"
        "The journals in DIR are read for what no recording holds: trials skipped or done again later.",
        "phd analyze study-1 --out study-1-again", prints="the summary",
    ).add_argument  # fmt: skip
    option("dir", **FOLDER)
    option("--out", type=Path, metavar="OUT", help="a new folder (default: DIR/analysis-N)")
    option(
        "--unblind", action="store_true",
        help="open the keys of blind sessions for this analysis; who did it, and when, is written into their journals",
    )  # fmt: skip
    option(
        "--beside", type=Path, nargs="+", default=[], metavar="DIR",
        help="further studies: the findings of all, from their trials.csv, side by side in OUT/side-by-side.md",
    )  # fmt: skip
    timeouts = "put trials whose time was up into boxes and statistics, which leave them out otherwise"
    option("--timeouts", action="store_true", help=timeouts)
    option = add_verb(
        verbs, "export", export_verb, "write a study's recordings as BIDS-Motion or as CSV",
        "Each into a new folder, whole or not at all; both may be asked for at once. A recording that is damaged or\n"
        "was cut off is left out and named. While a session is blind, controllers keep their codes and what the\n"
        "brakes did is not exported. Answers to the questionnaire go into both, the experimenter's notes into CSV.",
        "phd export study-1 --bids study-1-bids", prints="the summary",
    ).add_argument  # fmt: skip
    option("dir", **FOLDER)
    option("--bids", type=Path, metavar="OUT", help="a new or empty folder for a BIDS-Motion data set")
    option("--csv", type=Path, metavar="OUT", help="a new or empty folder for CSV: trials.csv and each recording")
    option = add_verb(
        verbs, "verify", verify_verb, "check that every recording of a folder is whole, or marked as recovered",
        "Writes nothing. Exit 0: it is so (an unfinished plan is no fault). Exit 1: each damaged batch, missing\n"
        "recording, trial that was cut off, and table that disagrees is named.",
        "phd verify study-1", prints="what was found",
    ).add_argument  # fmt: skip
    option("dir", **FOLDER)
    option = add_verb(
        verbs, "recover", recover_verb, "rescue what a crash left: every whole batch of a trial that was cut off",
        "The trial gets a recording and a row marked as recovered; the file that the crash left is kept beside it.\n"
        "Exit 0: phd verify finds no fault any more. Exit 1: what is left is named. A folder that a running process\n"
        "uses is refused. phd study --resume does the same before it goes on.",
        "phd recover study-1", prints="what was done",
    ).add_argument  # fmt: skip
    option("dir", **FOLDER)


def analyze_verb(args: argparse.Namespace) -> None:
    from experiments.study.analyze import analyze, read_studies, write_side_by_side

    studies = read_studies([args.dir, *args.beside]) if args.beside else {}
    unblinded_by = getpass.getuser() if args.unblind else ""
    summary = with_progress("analyzing", analyze, args.dir, args.out, unblinded_by, args.timeouts)
    if studies:
        summary["side_by_side"] = str(write_side_by_side(studies, Path(summary["out"])))
    answer(args, summary, as_text(summary))


def export_verb(args: argparse.Namespace) -> None:
    outs = {form: out for form, out in (("bids", args.bids), ("csv", args.csv)) if out is not None}
    if not outs:
        raise InputError("export: nothing to write, give --bids OUT or --csv OUT (see phd export --help)")
    from experiments.export.export import export

    summary = with_progress("exporting", export, args.dir, outs)
    answer(args, summary, as_text(summary))


def verify_verb(args: argparse.Namespace) -> int:
    from experiments.session.verify import verify

    found = with_progress("verifying", verify, args.dir)
    doubts = found["warnings"]
    text = as_text(found | {"in_doubt": len(doubts), "warnings": []})
    answer(args, found, text, (f"{doubt['file']}: {doubt['warning']}" for doubt in doubts))
    return 1 if found["faults"] else 0


def recover_verb(args: argparse.Namespace) -> int:
    from experiments.session.recover import recover

    done = with_progress("recovering", recover, args.dir)
    answer(args, done, as_text(done))
    return 1 if done["faults"] or done["not_rescued"] else 0
