"""The process of an export: a pickled ResultsJob on standard input, progress and errors on standard error."""

import contextlib
import os
import pickle
import signal
import sys

from app.progress import ProgressBar
from core.files import InputError
from experiments.export.results_files import write_results

NICE = 10  # behind everything that keeps time


def main() -> None:
    """Write the files; how many of them stands on standard output."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))  # let half-written files be removed
    if hasattr(os, "nice"):
        os.nice(NICE)
    job = pickle.load(sys.stdin.buffer)
    try:
        with contextlib.closing(ProgressBar("writing")) as progress:
            count = write_results(job, progress)
    except InputError as error:
        print(error, file=sys.stderr)
    else:
        print(f"{count} file{'s' if count != 1 else ''} written to {job.folder}")
