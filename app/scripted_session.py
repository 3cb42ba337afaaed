"""A session that a Python program runs, trial by trial. The window and every verb can open it like any other.

    with phd.Session("mine.toml", participant="01", folder="data") as session:
        for trial in session:
            trial.run(hand)

hand: `SimulatedPerson`, or a function that gets a `HandTick` each millisecond and returns the force of the hand, N. On
a real or emulated device (`port`) it is the hand at the handle.
"""

import contextlib
import gc
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

import numpy as np
import pandas as pd

from app.frames import Frame
from core import tick_log
from core.device import Device
from core.device_interface import DeviceError, DeviceSample, RealDevice
from core.files import InputError
from core.path import outline
from core.ranges import FORCE
from core.tick_log import TICK_S
from experiments import inputs
from experiments.analysis.trials_table import TrialRow, as_table
from experiments.plan import PlannedTrial, make_plan, participant_index
from experiments.protocol import Protocol, home_of, load_protocol
from experiments.recording import Sensors
from experiments.store.files import is_half_created, session_folder
from experiments.store.journal import HOMED, ZEROED
from experiments.store.session import Participant
from experiments.store.session import Session as StoredSession
from experiments.study.unrecorded import person_of
from experiments.trial.population import USUAL, Population, load_population
from experiments.trial.real_trial import RealTrial, load_kernels
from experiments.trial.trial import Trial
from hardware.serial_device import device_at

NO_CURRENT = (0.0, 0.0, 0.0, 0.0)
CHUNK_TICKS = 8192
OUTLINE_M = 1e-3
FIRST_SAMPLE_S = 1.0  # longest wait for a sample of a device that was just opened


class HandTick(NamedTuple):
    """What a hand function gets each millisecond."""

    time_s: float  # since the trial began
    phase: str  # "approach", "hold" (at the start), "move" or "end"
    tip_m: tuple[float, float]  # (x, y) of the handle
    velocity_m_s: tuple[float, float]  # of the handle
    start_m: tuple[float, float]  # of the path
    end_m: tuple[float, float]  # of the path


#: A hand as a function: the force (x, y), N, for the next millisecond.
HandFunction = Callable[[HandTick], Sequence[float] | np.ndarray]


class SimulatedPerson:
    """A simulated operator as the hand: the one of `phd study` for this participant and seed."""

    def __init__(self, population: str | Path = USUAL) -> None:
        """population: a shipped name or a file."""
        self.population: Population = load_population(population)

    def _participant(self, label: str, seed: int) -> Participant:
        """The person of this label."""
        person = person_of(self.population, seed, participant_index(label))
        return Participant(label, inputs.OPERATOR, person, self.population.operators)


class Session:
    """A participant's session, in a `with` block. Iterate over it for the trials that are still to be run.

    An existing session is continued. However the block ends, what was recorded is kept.
    """

    def __init__(
        self, protocol: str | Path | Protocol = "paper", participant: str = "01", folder: str | Path = "phd-data",
        port: str = "",
    ) -> None:  # fmt: skip
        """protocol: a shipped name, a file, or what `protocol` returns. folder: of all sessions.

        port: of a real or emulated board ("/dev/ttyACM0", "auto", "socket://HOST:NUMBER"); "": simulated.
        """
        self.protocol = protocol if isinstance(protocol, Protocol) else load_protocol(protocol)
        self.protocol.refuse_unknown_low_gain()
        self.participant, self.data_folder, self._port = participant, Path(folder).absolute(), port
        participant_index(participant)
        self.folder = session_folder(self.data_folder, participant)  #: of this session
        self._stored: StoredSession | None = None
        self._bench: Bench | None = None

    def __enter__(self) -> Self:
        if not is_half_created(self.folder):
            self._stored = StoredSession.resume(self.data_folder, self.participant)
            if self._stored.protocol.text != self.protocol.text:
                self._close()
                raise InputError(f"{self.folder}: was begun with another protocol; name another participant or folder")
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._close()

    def _close(self) -> None:
        bench, stored = self._bench, self._stored
        self._bench = self._stored = None
        try:
            if bench is not None:
                bench.close()
        finally:
            if stored is not None:
                stored.end()

    def __iter__(self) -> Iterator["SessionTrial"]:
        """The trials that are still to be run, in the plan's order. InputError if one was neither run nor skipped."""
        while (planned := self._next()) is not None:
            trial = SessionTrial(self, planned)
            yield trial
            if not trial.over:
                raise InputError("the trial was not run: call trial.run(hand), or trial.skip(reason)")

    @property
    def trials(self) -> pd.DataFrame:
        """The trials so far, as `load_trials` reads them."""
        return self._table(self._stored.rows if self._stored else ())

    def _table(self, rows: Iterable[TrialRow]) -> pd.DataFrame:
        place = self.folder.relative_to(self.data_folder).as_posix()
        return Frame(as_table(row.in_folder(place) for row in rows))

    def _next(self) -> PlannedTrial | None:
        if self._stored is None:
            return make_plan(self.protocol, self.participant, coded=False)[0]
        return self._stored.next_planned()

    def _open(self, hand: SimulatedPerson | HandFunction | None) -> StoredSession:
        """The session on the disk, begun where it was not. InputError: it was begun with a hand of another kind."""
        if self._port:
            if hand is not None:
                raise InputError("hand: on a device the hand is the one at the handle: call trial.run() without")
            who = Participant(self.participant, inputs.SENSOR)
        elif isinstance(hand, SimulatedPerson):
            who = hand._participant(self.participant, self.protocol.seed)
        elif callable(hand):
            who = Participant(self.participant, inputs.PROGRAM)
        else:
            raise InputError(f"hand: must be a phd.SimulatedPerson or a function, not {hand!r}")
        if self._stored is None:
            self._stored = StoredSession(self.data_folder, who, self.protocol)
        elif (self._stored.hand, self._stored.person) != (who.hand, who.operator):
            raise InputError(f"{self.folder}: was begun with {inputs.INPUTS[self._stored.hand].begun_with}, of its own")
        return self._stored

    # ------------------------------------------------------------------------------------- a real or emulated device

    def home(self, tip_m: tuple[float, float] | None = None) -> None:
        """Home the encoders: the handle is held at `tip_m`; None: in the jig of the device file."""
        bench = self._reach()
        place = home_of(bench.device, self.protocol.paths) if tip_m is None else tip_m
        with bench.at_work() as device:
            device.home(place)
        self._open(None).journal(HOMED, tip_m=list(place), board=bench.board)

    def zero(self) -> None:
        """Zero the force sensor. Nobody may touch the handle for a second."""
        with self._reach().at_work() as device:
            record = device.zero()
        self._open(None).journal(ZEROED, **record._asdict())

    def reset(self) -> None:
        """Clear the board's latched fault. InputError: its cause is still there."""
        with self._reach().at_work() as device:
            device.reset()

    def _reach(self) -> "Bench":
        """The device of the coming trial, connected. InputError: it cannot be reached."""
        planned = self._next()
        if not self._port or planned is None:
            raise InputError("there is no device to use: the session has no port, or no trial is left")
        device = self.protocol.device(planned.configuration)
        if self._bench is not None and self._bench.device.name != device.name:
            self._bench.close()
            self._bench = None
        if self._bench is None:
            self._bench = Bench(device, self._port)
        return self._bench


class SessionTrial:
    """A trial of a `Session`, to be run or skipped.

    run_number, block, repetition: its place in the plan. controller, device: names. path_m: array (n, 2), its path.
    """

    def __init__(self, session: Session, planned: PlannedTrial) -> None:
        """Made by a `Session`."""
        self._session, self.over = session, False
        self.run_number, self.block = planned.run, planned.block
        self.device, self.repetition = planned.configuration, planned.repetition
        protocol = session.protocol
        numbered = protocol.controllers.get(planned.controller) if isinstance(planned.controller, int) else None
        self.controller = numbered.name if numbered else str(planned.controller)
        self.path_m = outline(protocol.paths[planned.path], OUTLINE_M)

    def run(self, hand: SimulatedPerson | HandFunction | None = None) -> pd.Series:
        """Run and record the trial. Returns its row, with every measure.

        hand: a `SimulatedPerson`, or a function that takes a `HandTick` and returns the force (x, y), N; None on a
        board. An exception stops the trial, brakes off; it is run again later.
        """
        stored = self._session._open(hand)
        bench = self._session._reach() if hand is None else None
        planned = stored.next_planned()
        if self.over or planned is None:
            raise InputError("the trial was run already: take the next one of the session")
        if hand is not None and not isinstance(hand, SimulatedPerson):
            let_go(stored.simulation(planned.configuration).hand.grips)
        trial, writer = stored.begin(planned, bench.sensors() if bench else None)
        self.over = True
        with writer:
            ticks = run_real(trial, bench) if bench else run_simulated(trial, hand)
            try:
                for rows in ticks:
                    writer.write(rows)
            except BaseException as error:
                trial.abort(f"the program stopped it ({type(error).__name__})")
                for rows in run_real(trial, bench) if bench else run_simulated(trial, None):
                    writer.write(rows)
                stored.finish(trial, writer, cut_short=True)
                raise
            row = stored.finish(trial, writer)
        if not bench:
            trial.refuse_failed_controller()
        return self._session._table([row]).iloc[0]

    def skip(self, reason: str) -> None:
        """Never run this trial. reason: for the journal. InputError: no trial of the session has been run yet."""
        if self._session._stored is None:
            raise InputError("trial.skip: run the first trial, it says whose hand the session has")
        self._session._stored.skip(reason)
        self.over = True


def let_go(grips: np.ndarray) -> None:
    """The hand is a force alone: no spring pulls."""
    grips["spring"][0] = 1
    grips["stiffness"][0] = grips["damping"][0] = grips["held"][0] = 0.0


def run_simulated(trial: Trial, hand: Any) -> Iterator[np.ndarray]:
    """The ticks (n, tick_log.WIDTH) of a trial on a simulated device. hand: None: none acts by itself."""
    rows, grips = np.empty((CHUNK_TICKS, tick_log.WIDTH)), trial.simulation.hand.grips
    if hand is None or isinstance(hand, SimulatedPerson):
        if hand is None:
            grips["held"][0] = 0.0
        while not trial.finished:
            yield rows[: trial.run(rows)]
        return
    run, body, path = trial.arguments().run, trial.simulation.body, trial.path
    run["approach_ticks"][0] = round(trial.trial_rules.approach_time_out_s / TICK_S)
    start, end = (path.x0, path.y0), (path.x1, path.y1)
    while not trial.finished:
        x, y, vx, vy = body["tip"][0].tolist()
        fx, fy = hand(HandTick(trial.ticks * TICK_S, trial.phase, (x, y), (vx, vy), start, end))
        for force in (fx, fy):
            if reason := FORCE.refusal(float(force)):
                raise InputError(f"the force of the hand {reason}")
        grips["held"][0] = fx, fy
        grips["target"][0] = x, y, 0.0, 0.0
        trial.run(rows[:1])
        yield rows[:1]


def run_real(trial: Trial, bench: "Bench") -> Iterator[np.ndarray]:
    """The ticks (n, tick_log.BENCH_WIDTH) of a trial on a device, at its end: no disk is waited for before."""
    assert isinstance(trial, RealTrial)
    rows: list[np.ndarray] = []
    collects = gc.isenabled()
    gc.disable()
    try:
        with bench.at_work() as device:
            trial.connect(device)
            try:
                while not trial.finished:
                    rows += trial.exchange()
            except BaseException as error:
                trial.abort(f"the program stopped it ({type(error).__name__})")
                while not trial.finished:
                    rows += trial.exchange()
                raise
            finally:
                trial.leave()
    finally:
        if collects:
            gc.enable()
        if rows:
            yield np.array(rows)


class Bench:
    """A device on the bench. Between trials a thread exchanges zero currents with it, so that it is not lost."""

    def __init__(self, device: Device, port: str) -> None:
        """InputError: it cannot be reached, or is another one."""
        self.device = device
        load_kernels()
        self._real: RealDevice = device_at(device, port)
        self._real.open()
        self._lock, self._ended = threading.Lock(), threading.Event()
        self._sample: DeviceSample | None = None
        self._thread = threading.Thread(target=self._idle, name="board between trials", daemon=True)
        self._thread.start()

    def _idle(self) -> None:
        while not self._ended.wait(1e-4):
            with self._lock:
                self._sample = self._real.exchange(NO_CURRENT) or self._sample
                self._real.samples()

    @contextlib.contextmanager
    def at_work(self) -> Iterator[RealDevice]:
        """The device, for this thread alone. Its errors become InputError."""
        with self._lock:
            try:
                yield self._real
            except DeviceError as error:
                raise InputError(str(error)) from None

    @property
    def board(self) -> str:
        """The name of its board."""
        return str(self._real.report().get("board", ""))

    def sensors(self) -> Sensors:
        """Its sensors. InputError: it is not ready for a trial."""
        for _ in range(round(FIRST_SAMPLE_S / TICK_S)):
            if self._sample is not None or self._ended.wait(TICK_S):
                break
        sample = self._sample
        if self._real.problem or sample is None:
            raise InputError(f"the device is not ready: {self._real.problem or 'no sample came'}")
        if sample.fault:
            raise InputError(f"the device is not ready: {sample.fault}; see to it and call session.reset()")
        if not sample.homed:
            raise InputError("the device is not homed: hold the handle at its jig and call session.home()")
        if not self._real.zeroed:
            raise InputError("the force sensor has no zero: let go of the handle and call session.zero()")
        return Sensors(self._real.encoders, self._real.force_channels)

    def close(self) -> None:
        """Zero currents, and disconnect."""
        self._ended.set()
        self._thread.join()
        self._real.close()
