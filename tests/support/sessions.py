"""Sessions for tests: real trials of a simulated operator on the shipped devices, and what a crash leaves of them."""

import contextlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
from protocols import PAPER
from synthetic_hand import SyntheticHand

from core import tick_log
from experiments.protocol import Protocol
from experiments.store.overview import scan_folder
from experiments.store.session import Participant, Session
from experiments.trial.population import load_population


class Killed(BaseException):
    """Stands for a kill: nothing that tidies up after exceptions of the program may catch it."""


def killing(after: Callable | None = None) -> Callable:
    """Stands in place of a function: the process is killed in it, or once it has done what it does (`after`)."""

    def kill(*arguments, **options):
        if after is not None:
            after(*arguments, **options)
        raise Killed

    return kill


def of(data: Path) -> Path:
    """The folder of the first participant's session."""
    return data / "sub-01" / "ses-01"


def recording_path(session: Path, run: int) -> Path:
    """The recording of a trial."""
    return session / "trials" / f"run-{run:03d}.parquet"


def unfinished(data: Path) -> tuple[str, ...]:
    """Participants whose session can go on."""
    return tuple(sorted(one.participant for one in scan_folder(data).sessions if not one.complete))


def new_session(data: Path, participant: str = "01", protocol: Protocol = PAPER, blind: bool = False) -> Session:
    """A session of a simulated operator, not yet begun."""
    population = load_population("average")
    person = population.draw(np.random.default_rng(3))
    who = Participant(participant, operator=person, population=population.operators)
    return Session(data, who, protocol, blind, sync=False)


def run_trials(session: Session, count: int) -> None:
    """The next trials of the plan, from begin to row."""
    for _ in range(count):
        trial, writer = session.begin(session.next_planned())
        run(trial, writer)
        session.finish(trial, writer)


def run(trial, writer, ticks: int = 10**9, piece: int = 500) -> None:
    """Ticks of a trial into its recording, a batch a piece."""
    rows = np.empty((piece, tick_log.WIDTH))
    while not trial.finished and trial.ticks < ticks:
        writer.write(rows[: trial.run(rows)])
        writer.flush()


def run_to_move(trial, writer) -> None:
    """Its ticks, one by one, until the movement begins."""
    rows = np.empty((1, tick_log.WIDTH))
    while trial.phase != "move":
        writer.write(rows[: trial.run(rows)])


def move_to_the_end(trial, writer, most: int = 60_000) -> None:
    """A hand at the mouse that follows the trial to its end."""
    tip = trial.simulation.body["tip"][0]
    hand, rows = SyntheticHand(trial.planned.path, (tip[0], tip[1])), np.empty((20, tick_log.WIDTH))
    while not trial.finished and trial.ticks < most:
        trial.aim(*hand((tip[0], tip[1]), tick_log.PHASES.index(trial.phase), 0.02))
        writer.write(rows[: trial.run(rows)])


def crash_in_trial(session: Session, ticks: int = 2500, closed: bool = False) -> Path:
    """Begin the next trial, end as a killed process does in the middle of it; its recording."""
    trial, writer = session.begin(session.next_planned())
    run(trial, writer, 10**9 if closed else ticks)
    if closed:
        writer.close(trial.outcome())
    writer.flush()
    kill(session)
    return session.folder / "trials" / f"run-{trial.planned.run:03d}.parquet"


def kill(session: Session) -> None:
    """What the end of a killed process does: nothing is written or sealed, and the lock is free."""
    session.abandon()


def files(folder: Path) -> dict[str, bytes]:
    """Everything in a folder, by name."""
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@contextlib.contextmanager
def session_of(data: Path, trials: int, **how):
    """A session in which some trials have been run; closed at the end."""
    session = new_session(data, **how)
    try:
        run_trials(session, trials)
        yield session
    finally:
        session.close()


def closed_session(data: Path, trials: int, **how) -> Session:
    """The same, closed."""
    with session_of(data, trials, **how) as session:
        return session
