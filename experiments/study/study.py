"""`phd study`: the paper's whole study with simulated operators, from plan to box plots; goes on after a crash."""

import contextlib
import shutil
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from core import tick_log
from core.files import InputError
from core.tick_log import TICK_S
from experiments.analysis.chart_figures import SCREEN, draw_boxplots
from experiments.analysis.findings import (
    CANNOT_TELL,
    DEPENDS,
    FAILS,
    HOLDS,
    Finding,
    box_findings_of,
    findings,
    why_no_findings,
)
from experiments.analysis.gap_reading import GapReadOtherwise
from experiments.analysis.own_measures import own_metrics
from experiments.analysis.report import warnings, write_report
from experiments.analysis.simulation_errors import Moved
from experiments.analysis.trials_table import COUNTED, StudyData, Trials, without_value
from experiments.atomic_files import is_wrong_path, make_empty_folder, new_folders
from experiments.numbers import in_words
from experiments.own_controller import refuse_unusable
from experiments.plan import PlannedTrial, make_plan
from experiments.progress import Progress, no_progress
from experiments.protocol import Protocol
from experiments.store.files import LOCK, STUDY, hold_lock, is_half_created, session_folder, write_pooled_table
from experiments.store.journal import TRIAL_CUT_OFF
from experiments.store.recording import RecordingWriter
from experiments.store.session import Participant, Session
from experiments.store.study_plan import StudyPlan, note_sessions, read_study, refuse_other, write_study
from experiments.study.gap_reading import gap_read_otherwise
from experiments.study.helpers import Helpers, Shared, helpers, shared_in_helper
from experiments.study.jobs import going_on
from experiments.study.unrecorded import errors_in, person_of, with_low_gain_found
from experiments.trial.operator import Person
from experiments.trial.population import Population
from experiments.trial.real_trial import load_kernels
from experiments.trial.trial import Trial

#: Ticks run at a time: long enough that a call costs nothing, short enough that an interrupt is heard.
CHUNK_TICKS = 8192
FIGURES, REPORT = "figures", "report"
MOST_OPERATORS = 1000  # our choice: 60,000 of the paper's trials
TRIAL_BYTES = 800_000  # of a recording of the paper's protocol, about: the mean over 120 was 780 kB


def run_study(
    out: Path,
    operators: int,
    protocol: Protocol,
    population: Population,
    purpose: str = SCREEN,
    progress: Progress = no_progress,
) -> dict:
    """Run every operator's session into `out`, a new or empty folder; the summary. InputError for wrong input.

    purpose: of the figures, as `draw_boxplots` has it.
    """
    out = Path(out)
    refuse_too_many(out, operators, protocol)
    own_metrics(protocol)  # InputError: its own measures cannot be used
    refuse_unusable(protocol.controllers.values())
    left = [f".{STUDY}.partial{end}" for end in ("", "-journal", "-wal", "-shm")]  # by a crash
    make_empty_folder(out, "a study needs a new or empty folder (or --resume)", (LOCK, *left))
    load_kernels()  # no clock runs while they are compiled
    with helpers(operators) as workers, hold_lock(out):
        study = StudyPlan(operators, with_low_gain_found(protocol, population), population)
        write_study(out, study)
        return run_to_the_end(out, study, workers, purpose, progress)


def resume_study(
    out: Path, options: Mapping[str, object], purpose: str = SCREEN, progress: Progress = no_progress
) -> dict:
    """Go on with an interrupted study as it was begun: what a crash left is recovered, then every trial of the plan
    that is still to be run is run. A study that is complete is left as it is. The summary.

    options: by name (see `refuse_other`); they must be those with which the study was begun.
    An operator whose session was cut runs the rest with devices just switched on, so these trials are not the ones
    of an uninterrupted study, bit by bit; those of operators not begun, or done, are.
    InputError if there is no study, an option differs, or a live process has it.
    """
    out = Path(out)
    study = read_study(out)
    refuse_other(out, study, options)
    load_kernels()
    with helpers(study.operators) as workers, hold_lock(out):
        return run_to_the_end(out, study, workers, purpose, progress)


def refuse_too_many(out: Path, operators: int, protocol: Protocol) -> None:
    """InputError for more operators than a study may have, or than the disk of `out` has room for."""
    if operators > MOST_OPERATORS:
        raise InputError(f"--operators: at most {MOST_OPERATORS}, not {operators}; a sweep keeps no recordings")
    existing = next(folder for folder in (out, *out.absolute().parents) if folder.is_dir())
    wanted = operators * len(make_plan(protocol, "01", coded=False)) * TRIAL_BYTES
    if wanted > (free := shutil.disk_usage(existing).free):
        raise InputError(
            f"{out}: this study records about {1e-6 * wanted:.0f} MB, and {1e-6 * free:.0f} MB are free there: "
            "take fewer --operators or another folder"
        )


def run_to_the_end(out: Path, study: StudyPlan, workers: Helpers, purpose: str, progress: Progress) -> dict:
    """Run all trials that are not done yet; the summary. An interrupt says how the study goes on."""
    try:
        return StudyRun(out, study, workers.shared, progress, purpose).carry_out(workers)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(going_on(out)) from None


@dataclass
class StudyRun:
    """One process's part of a study: each takes on the next operator that no other has."""

    out: Path
    study: StudyPlan
    shared: Shared
    progress: Progress = no_progress
    purpose: str = SCREEN  # of the figures
    done: Counter[str] = field(default_factory=Counter)  # ticks, simulating_ns; trials, and of them in_doubt
    failed: list[str] = field(default_factory=list)  # why a measure of one's own gave no number, for each trial
    rows: np.ndarray = field(default_factory=lambda: np.empty((CHUNK_TICKS, tick_log.WIDTH)))

    @property
    def people(self) -> dict[str, Person]:
        """The operators by their labels."""
        numbers = range(1, self.study.operators + 1)
        return {f"{n:02d}": person_of(self.study.population, self.study.protocol.seed, n) for n in numbers}

    def carry_out(self, workers: Helpers) -> dict:
        """Run all trials that are not done yet, with the helpers, then write the table and the figures."""
        began = time.perf_counter()
        protocol, population, operators = self.study.protocol, self.study.population, self.study.operators
        errors, gap, others = None, None, []
        for operator in self.shared.operators(operators):
            with self.session(f"{operator:02d}") as session:
                if errors is None and session.next_planned():  # from here on the helpers have something to do
                    errors = workers.pool.submit(errors_in, self.out)
                    gap = workers.pool.submit(gap_read_otherwise, protocol, self.people)
                    others = [workers.pool.submit(run_share, self.out, self.study) for _ in range(workers.processes)]
                self.run_operator(session)
        for other in others:
            done, failed = other.result()
            self.done.update(done)
            self.failed += failed
        note_sessions(self.out)
        table = write_pooled_table(self.out)
        if self.done["trials"] or not (self.out / FIGURES).exists() or not (self.out / REPORT).exists():
            errors = errors or workers.pool.submit(errors_in, self.out)
            gap = gap or workers.pool.submit(gap_read_otherwise, protocol, self.people)
            self.conclude(table, workers, errors.result(), gap.result())
        share_done = (table["status"] == "done").groupby(table["controller"]).mean()
        refusal = why_no_findings(protocol.controllers)
        found = [] if refusal else findings(table)
        return {
            "out": str(self.out),
            "trials": len(table),
            "trials_run_now": self.done["trials"],
            "controllers": [
                {"controller": number, "name": preset.name, "share_reached": float(share_done.get(number, 0.0))}
                for number, preset in protocol.controllers.items()
            ],
            "recovered": int((table["status"] == "recovered").sum()),
            "in_doubt": self.done["in_doubt"],
            "findings_by_boxes": refusal or verdicts(box_findings_of(table)),
            "findings_within_participants": refusal or verdicts(found),
            "protocol": protocol.name,
            "population": population.name,
            "operator_numbers_changed_after_findings": list(population.changed_after_findings) or "none",
            "rules": protocol.rules,
            "low_gain_N_s_m": protocol.low_gain,
            "assumed": in_words((*protocol.assumed_of, *population.assumed_of)) or "nothing",
            "simulated_s": self.done["ticks"] * TICK_S,
            "simulation_wall_s": 1e-9 * self.done["simulating_ns"],
            "wall_s": time.perf_counter() - began,
            "warnings": [
                *warnings(table, found, simulated=True),
                *without_value(table, own_metrics(protocol), self.failed),
            ],
        }

    @contextlib.contextmanager
    def session(self, label: str) -> Iterator[Session]:
        """An operator's session: a new one, or the one that was begun."""
        protocol, population = self.study.protocol, self.study.population
        if not is_half_created(session_folder(self.out, label)):
            session = Session.resume(self.out, label, sync=False)
        else:
            who = Participant(label, operator=self.people[label], population=population.operators)
            session = Session(self.out, who, protocol, sync=False)
        try:
            yield session
        except BaseException:
            session.abandon()
            raise
        session.close()

    def run_operator(self, session: Session) -> None:
        """Run the trials that an operator has still to do."""
        shared, whole = self.shared, self.study.operators * len(session.plan)
        with shared.finished:
            shared.finished.value += session.finished_count
        while not shared.stop.is_set() and (planned := session.next_planned()):
            self.run_trial(session, planned)
            with shared.finished:
                shared.finished.value += 1
            self.progress(shared.finished.value / whole)

    def run_trial(self, session: Session, planned: PlannedTrial) -> None:
        """One trial, from its first tick to its row. OSError, as one sentence, if the disk takes no more."""
        try:
            trial, writer = session.begin(planned)
            with writer:
                self.run_ticks(trial, writer)
                row = session.finish(trial, writer)
        except OSError as error:
            if is_wrong_path(error):
                raise
            with contextlib.suppress(OSError):
                session.journal(TRIAL_CUT_OFF, run=planned.run, reason=error.strerror or str(error))
            raise OSError(
                error.errno,
                f"{error.strerror or error}, so the study stopped in run {planned.run} of participant "
                f"{session.participant}; all that was recorded is kept, phd study --resume goes on from there",
                str(self.out),
            ) from error
        if row.status in COUNTED:
            self.failed += row.failed.values()
        trial.refuse_failed_controller()  # it is kept, as aborted
        self.done["trials"] += 1
        self.done["in_doubt"] += bool(trial.outcome()["warnings"])  # its energy ledger contradicts its motion

    def run_ticks(self, trial: Trial, writer: RecordingWriter) -> None:
        """Every tick of a trial into its recording."""
        while not trial.finished:
            start = time.perf_counter_ns()
            n = trial.run(self.rows)
            self.done["simulating_ns"] += time.perf_counter_ns() - start
            writer.write(self.rows[:n])
        self.done["ticks"] += trial.ticks

    def conclude(self, table: Trials, workers: Helpers, moved: Sequence[Moved], gap: GapReadOtherwise | None) -> None:
        """Box plots and report; each folder appears whole, in place of one from before a crash."""
        protocol, operators = self.study.protocol, self.study.population.operators
        caption, note = (f"{protocol.note()}, {about}" for about in (operators.label, operators.note))
        own = own_metrics(protocol)
        data = StudyData(table, protocol.controllers, protocol.name, caption, note, simulated=True, own=own)
        for name in (FIGURES, REPORT):
            shutil.rmtree(self.out / name, ignore_errors=True)
            with new_folders([self.out / name], "a study") as (folder,):
                if name == FIGURES:
                    draw_boxplots(data, folder, pool=workers.pool, purpose=self.purpose)
                else:
                    write_report(data, folder, moved=moved, gap=gap)


def run_share(out: Path, study: StudyPlan) -> tuple[Counter[str], list[str]]:
    """In a helper: run operators as long as there are any; as `StudyRun.done` and `failed`."""
    shared = shared_in_helper()
    run = StudyRun(out, study, shared)
    try:
        for operator in shared.operators(study.operators):
            with run.session(f"{operator:02d}") as session:
                run.run_operator(session)
    except BaseException:
        shared.stop.set()
        raise
    return run.done, run.failed


def verdicts(found: Sequence[Finding]) -> str:
    """The paper's statements counted by verdict, as a sentence."""
    counted = Counter(finding.verdict for finding in found)
    counts = (f"{verdict}: {counted[verdict]}" for verdict in (HOLDS, FAILS, CANNOT_TELL, DEPENDS) if counted[verdict])
    return f"{', '.join(counts)} (of the paper's {len(found)}; why: {REPORT}/report.md)"
