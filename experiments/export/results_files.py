"""Files of results: figures and tables of what is seen on a page, and reports of sessions; never over others."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path

from core.files import InputError
from experiments.analysis.chart_figures import draw_charts
from experiments.analysis.charts import charts
from experiments.analysis.trials_table import write_table
from experiments.export.answers import answers_and_notes, write_answers_and_notes
from experiments.export.results import Job
from experiments.export.session_report import write_session_report
from experiments.recording.atomic_files import rename
from experiments.session.files import TABLE


def write_results(job: Job, progress: Callable[[float], None] = lambda share: None) -> int:
    """Write what is seen: the page's figures, the trials, what was answered and noted; how many files.

    The folder appears whole. progress: called with the share done. InputError says why nothing was written.
    """
    if job.folder.exists():
        raise InputError(f"{job.folder}: exists already, the results need a new folder")
    partial = job.partial
    here = Path(os.path.relpath(job.data_dir, job.folder)).as_posix()
    try:
        partial.mkdir(parents=True)
        if job.report:
            for number, session in enumerate(job.sessions, start=1):
                name = f"{session.parent.name}_{session.name}_report.pdf"
                write_session_report(session, partial / name)
                progress(number / len(job.sessions))
        else:
            shown = charts(job.page, job.rows, job.view, job.answers)
            draw_charts(shown, job.rows, partial, job.note, job.view, progress)
            write_table(partial / TABLE, [row.seen_from(here) for row in job.rows])
            write_answers_and_notes(partial, answers_and_notes(job.sessions))
        count = len(list(partial.iterdir()))
        rename(partial, job.folder)
    except OSError as error:
        raise InputError(f"{job.folder}: cannot be written ({(error.strerror or str(error)).lower()})") from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return count
