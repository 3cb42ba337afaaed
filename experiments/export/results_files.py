"""Files of results: the figures and tables of a page, and reports of sessions; never over other files."""

import io
import os
import textwrap
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure

from core import tick_log
from core.files import InputError
from experiments.analysis import by_path
from experiments.analysis.chart_figures import draw_chart, draw_charts
from experiments.analysis.charts import ORDER, POOLED, Chart, View, charts, left_out, legend
from experiments.analysis.colours import colour_places
from experiments.analysis.metrics import BY_NAME, DRAWN
from experiments.analysis.sheet import QUIET, STYLE, new_figure
from experiments.analysis.trials_table import STATUSES, Trials, as_rows, as_table, frame_bytes, to_compare, write_table
from experiments.atomic_files import new_folders, reason_of, write_new_file
from experiments.export.files import answers_and_notes, write_answers_and_notes
from experiments.export.results import Results, ResultsJob, read_results
from experiments.progress import Progress, no_progress
from experiments.store import journal
from experiments.store.cells import trial_names
from experiments.store.files import TABLE
from experiments.store.recording import read_recording
from experiments.store.stored import StoredSession, read_stored

PAGE = 8.27, 11.69  # inches: A4
MARGIN, LINE = 0.8, 0.19  # inches
CHARACTERS = 92  # of a line of small text
LOOKS: dict[str, dict[str, Any]] = {
    "title": {"fontsize": 14.0},
    "head": {"fontsize": 10.5},
    "text": {"fontsize": 9.0},
    "fixed": {"fontsize": 6.2, "family": "DejaVu Sans Mono"},  # a table, in letters of one width
}
#: What is listed under "Faults and decisions", as a sentence over the fields of the event and the name of its trial.
LISTED = {
    journal.BRAKES_OFF.name: "brakes off: {cause}",
    journal.LOOP_LOST.name: "{trial}: the control loop ended: {reason}",
    journal.WINDOW_LOST.name: "the window ended while the session was open",
    journal.REPAIRED.name: "what a crash had left open was closed",
    journal.CLOCK_JUMPED.name: "the clock of the computer was set by {seconds} s",
    journal.SKIPPED.name: "{trial} skipped: {reason}",
    journal.REDONE.name: "{trial} repeated: {reason}",
    journal.EXCLUDED.name: "{trial} excluded: {reason}",
    journal.PAUSED.name: "paused",
    journal.UNBLINDED.name: "the key was opened by {who}",
}


def write_results(job: ResultsJob, progress: Progress = no_progress) -> int:
    """Write what the page shows: its figures, the trials, the answers and notes; how many files.

    The folder appears whole, or InputError and no folder. progress: called with the share done.
    """
    data_dir = Path(os.path.relpath(job.data_dir, job.folder)).as_posix()
    try:
        with new_folders([job.folder], "a folder of results") as (folder,):
            if job.report:
                for number, session in enumerate(job.sessions, start=1):
                    write_session_report(session, folder / f"{session.parent.name}_{session.name}_report.pdf")
                    progress(number / len(job.sessions))
            else:
                shown = charts(job.page, job.trials, job.view, job.answers)
                draw_charts(shown, job.trials, folder, job.note, job.view, progress)
                of_paths = by_path.by_path(job.trials, job.view.names, job.view.timeouts)
                write_new_file(folder / by_path.NAME, frame_bytes(of_paths))
                write_table(folder / TABLE, as_table(row.in_folder(data_dir) for row in as_rows(job.trials)))
                write_answers_and_notes(folder, *answers_and_notes(job.sessions))
            return len(list(folder.iterdir()))
    except OSError as error:
        raise InputError(f"{job.folder}: cannot be written ({reason_of(error)})") from None


def write_session_report(session: Path, out: Path) -> None:
    """Write the report of a session's folder (.../sub-01/ses-01) into a new PDF.

    InputError if the session cannot be read, or the file exists.
    """
    results, lines = read_results(session), session_lines(session)
    if results.problems:
        raise InputError("; ".join(results.problems))
    sink = io.BytesIO()
    with matplotlib.rc_context(STYLE), PdfPages(sink, metadata={"CreationDate": None, "Producer": None}) as pdf:
        for figure in _text_pages(lines):
            pdf.savefig(figure)
        colours = colour_places(results.controllers)
        view = View(results.configurations, results.labels, results.lengths, colours=colours)
        for title, page in (("Measures by controller", POOLED), ("Measures in the order of the trials", ORDER)):
            pdf.savefig(_figure_page(title, charts(page, results.trials, view), results, view))
    write_new_file(out, sink.getvalue())


def session_lines(session: Path) -> list[tuple[str, str]]:
    """The report's text in lines, each with its kind: one of `LOOKS`. InputError if the session cannot be read."""
    stored, results, events = read_stored(session), read_results(session), journal.read_events(session)
    return [
        ("title", f"Session of participant {stored.participant}"),
        *_head_lines(stored, results, events),
        *_measures(results),
        *_timing(session, results.trials),
        *_faults_and_decisions(events, {run: name for (_, run), name in trial_names(as_rows(results.trials)).items()}),
    ]


def _head_lines(
    stored: StoredSession, results: Results, events: Sequence[journal.JournalEntry]
) -> Iterator[tuple[str, str]]:
    about = stored.about
    versions = about["versions"]
    count = Counter(results.trials["status"])
    yield "text", f"Begun {about['created']}, last entry {events[-1].time if events else 'none'} (UTC)."
    yield "text", f"Protocol {results.protocol}: {results.note}."
    blind = " The session was begun blind." if about.get("blind") else ""
    yield "text", f"Hand: {about.get('hand', 'not recorded')}.{blind}"
    made_by = f"phd {versions['phd']}, Python {versions['python']}"
    yield "text", f"Seed {about['seed']}; plan {about['plan_sha256'][:12]}; {made_by}."
    yield "head", "Plan"
    listed = ", ".join(f"{count[status]} {status}" for status in STATUSES if count[status])
    yield "text", f"{len(stored.plan)} trials planned; {len(results.trials)} rows: {listed or 'none'}."
    if text := left_out(results.trials):
        yield "text", text.replace("crosses above the scale, not in the boxes", "not in the numbers below")


def _measures(results: Results) -> Iterator[tuple[str, str]]:
    yield "head", "Measures (median over trials that reached the end)"
    shown = (*DRAWN, BY_NAME["duration_s"], *results.own)
    for titles in ([metric.short for metric in shown], [metric.shown_unit for metric in shown]):
        first = ("device", "controller", "trials") if titles[0] == shown[0].short else ("", "", "")
        yield "fixed", "{:<14}{:<26}{:>7}".format(*first) + "".join(f"{title[:20]:>21}" for title in titles)
    compared = to_compare(results.trials)
    cells = dict(iter(compared.groupby(["configuration", "controller"], sort=False)))
    for configuration, controller in sorted(cells, key=str):
        trials, cell = cells[configuration, controller], ""
        for metric in shown:
            values = trials[metric.name].dropna() if metric.name in trials else ()
            cell += f"{metric.scale * float(np.median(values)):>21.{metric.decimals}f}" if len(values) else f"{'':>21}"
        name = " ".join(results.labels.get(controller, str(controller)).split())
        yield "fixed", f"{configuration[:13]:<14}{name[:25]:<26}{len(trials):>7}{cell}"


def _timing(session: Path, trials: Trials) -> Iterator[tuple[str, str]]:
    yield "head", "Timing of the control loop"
    lateness, warnings, timings, names = [], [], [], trial_names(as_rows(trials))
    for row in as_rows(trials):
        if row.recording:
            recording, name = read_recording(session / row.recording), names[row.participant, row.run]
            if recording.damaged:
                warnings.append(f"{name}: {'; '.join(recording.damaged)}")
            warnings += [f"{name}: {warning}" for warning in recording.outcome.get("warnings", ())]
            if recording.rows:
                lateness.append(recording.column("lateness_us"))
                timings.append(recording.outcome.get("timing", {}))
    late = np.concatenate(lateness) if lateness else np.zeros(1)
    if not late.any():
        yield "text", "The trials did not run in real time."
    else:
        half, most = np.quantile(late, (0.5, 0.99))
        missed = int(np.count_nonzero(late >= tick_log.MISSED_US))
        share = f"half of them at most {half:.0f} µs late, 99 % at most {most:.0f} µs, the latest {late.max():.0f} µs"
        ticks = f"{len(late)} ticks in {len(lateness)} recordings"
        yield "text", f"{ticks}: {share}; {missed} a millisecond or more."
        yield "text", lateness_causes(timings)
    for warning in warnings:
        yield "text", f"Warning: {warning}."


def lateness_causes(timings: Sequence[Mapping[str, Any]]) -> str:
    """The sentence on what made ticks late; a number that one recording lacks is "not known" of all."""

    def of_all(name: str, total: Callable[[list[float]], float] = sum, unit: str = "") -> str:
        values = [value for timing in timings if (value := timing.get(name)) is not None]
        return f"{total(values):.0f}{unit}" if len(values) == len(timings) else "not known"

    return (
        f"Time that the host of a virtual machine kept from the loop: {of_all('stolen_ms', unit=' ms')}. Time that the "
        f"loop waited for a processor core: {of_all('waited_ms', unit=' ms')}; times that its core was taken from it: "
        f"{of_all('switches')}. The longest tick itself: {of_all('tick_max_us', max, ' µs')}."
    )


def _faults_and_decisions(
    events: Sequence[journal.JournalEntry], trials: Mapping[int, str]
) -> Iterator[tuple[str, str]]:
    """trials: run -> name."""
    yield "head", "Faults and decisions"
    marks = [entry for entry in events if entry.event.name in LISTED]
    for entry in marks:
        trial = trials.get(run := entry.about.get("run", 0), f"trial {run}")
        yield "text", f"{entry.time[11:19]}  {LISTED[entry.event.name].format(**entry.about, trial=trial)}"
    if not marks:
        yield "text", "None."
    if notes := [entry for entry in events if entry.event is journal.NOTE]:
        yield "head", "Notes"
        for entry in notes:
            yield "text", f"{entry.time[11:19]}  {entry.about['text']}"


def _text_pages(lines: Sequence[tuple[str, str]]) -> Iterator[Figure]:
    figure, y = None, 0.0
    for kind, text in lines:
        for piece in textwrap.wrap(text, CHARACTERS) if kind == "text" else [text]:
            if figure is None or y < MARGIN:
                if figure is not None:
                    yield figure
                figure, y = new_figure(*PAGE), PAGE[1] - MARGIN
            y -= LINE if kind == "head" else 0.0
            figure.text(MARGIN / PAGE[0], y / PAGE[1], piece, **LOOKS[kind])
            y -= LINE
    if figure is not None:
        yield figure


def _figure_page(title: str, shown: Sequence[Chart], results: Results, view: View) -> Figure:
    figure = new_figure(*PAGE)
    figure.text(MARGIN / PAGE[0], 1.0 - MARGIN / PAGE[1], title, fontsize=12.0)
    for i, chart in enumerate(shown):
        axes = figure.add_axes((0.12, 0.68 - 0.29 * i, 0.8, 0.19))
        draw_chart(axes, chart)
    foot = " ".join((*legend(shown[0], view), left_out(results.trials)))
    for i, line in enumerate(reversed(textwrap.wrap(foot, 110))):
        figure.text(0.12, 0.02 + 0.013 * i, line, fontsize=7.0, color=QUIET)
    return figure
