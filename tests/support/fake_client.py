"""A session server without processes: says what a test wants, remembers what it was sent; and what it may say."""

import math
from pathlib import Path

import numpy as np
from msgspec.structs import replace

from app.ipc import messages as m
from core import tick_log
from experiments.analysis.trials_table import TrialRow
from experiments.plan import PlannedTrial, make_plan, plan_hash, time_left_s
from experiments.protocol import Protocol, load_protocol

PAPER = load_protocol()
DEVICES, PATHS, PRESETS = PAPER.devices, PAPER.paths, PAPER.controllers
PLAN = make_plan(PAPER, "01")
PRACTICE = PLAN[0]._replace(run=0, block=0)
TIP = (0.02, 0.39)

GREEN = (
    m.Check("Device", m.GOOD, "simulated"),
    m.Check("Hand", m.GOOD, "mouse"),
    m.Check("Loop", m.GOOD, "1 kHz, p99 31 µs"),
    m.Check("Disk", m.GOOD, "82 GB free"),
    m.Check("Recording", m.GOOD, "ready"),
)
RED = (
    m.Check("Device", m.BAD, "no answer for 3 s", "Plug the board in again; it is found without a restart."),
    m.Check("Hand", m.GOOD, "mouse"),
    m.Check("Loop", m.CAUTION, "12 ticks missed", "Close other programs, or allow real-time scheduling."),
    m.Check("Disk", m.BAD, "12 MB free", "A session needs about 400 MB: free some space or choose another folder."),
    m.Check("Recording", m.WAITING, "waiting"),
)


class FakeClient:
    """A session server without processes: the same API as `app.ipc.client.Client`, and of its ring."""

    def __init__(self) -> None:
        self.alive, self.stopped, self.taken = True, "", False
        self.ring, self.wants_other_folder = self, False
        self.sent: list = []
        self.inbox: list = []
        self.aimed: list[tuple[float, float]] = []
        self.off_causes: list[str] = []
        self.rows = np.empty((0, tick_log.WIDTH))
        self.setup = m.Setup(Path("data"))

    def send(self, intent: object) -> None:
        self.sent.append(intent)

    def receive(self) -> list:
        said, self.inbox = self.inbox, []
        return said

    def ticks(self) -> np.ndarray:
        rows, self.rows = self.rows, np.empty((0, tick_log.WIDTH))
        return rows

    def aim(self, x: float, y: float) -> None:
        self.aimed.append((x, y))

    def let_go(self) -> None:
        self.aimed.append((math.nan, math.nan))

    def brakes_off(self, cause: str) -> None:
        self.off_causes.append(cause)

    def stop(self, reason: str) -> None:
        self.stopped = reason


def paper(**changes) -> Protocol:
    """The paper's protocol with other keys."""
    return replace(PAPER, **changes)


def opened(participant: str = "01", protocol: Protocol = PAPER, **changes) -> m.Opened:
    """A session (or, with participant "", none yet) of a protocol."""
    plan = PLAN if participant else ()
    sha256 = plan_hash(plan) if plan else ""
    return m.Opened(participant, protocol, plan, sha256, "data/sub-01/ses-01", False, "mouse")._replace(**changes)


def result(trial: PlannedTrial, status: str = "done", error: float = 0.002) -> TrialRow:
    """The row of a trial that is over."""
    return TrialRow(
        "01", trial.run, trial.block, trial.configuration, trial.controller, trial.path, trial.repetition, status,
        recording=f"trials/run-{trial.run:03d}.parquet",
        measures={
            "path_error_m": error, "mean_tip_force_N": 3.0, "acceleration_dft_sum": 40.0, "duration_s": 2.4,
        },
    )  # fmt: skip


def before(**changes) -> m.Snapshot:
    """Before a session."""
    return m.Snapshot(m.NO_SESSION, checks=GREEN, practice=True)._replace(**changes)


#: stage -> the card that is up then
CARDS = {
    m.QUESTIONS: m.StepCard("Questions", "The participant answers them on the other screen.", ""),
    m.RERIG: m.StepCard("Change to four-brake", "Mount the four-brake linkage.", "It is done"),
    m.BREAK: m.StepCard("Break", "A break: let go of the handle and rest."),
}
SHORT_BREAK, LONG_BREAK = (CARDS[m.BREAK]._replace(wait_s=seconds) for seconds in (5.0, 60.0))


def ready(over: int = 0, **changes) -> m.Snapshot:
    """Ready for the next trial, after so many of the plan; or what comes before it, by its stage."""
    rows = tuple(result(trial, error=0.001 + 0.0001 * trial.run) for trial in PLAN[:over])
    coming = PLAN[over] if over < len(PLAN) else None
    left = time_left_s(PAPER, PLAN, PLAN[over:])
    snapshot = m.Snapshot(m.READY, rows, coming, None, tip=TIP, checks=GREEN, seconds_left=left)
    newest = changes.get("rows", rows)[-1] if changes.get("rows", rows) else None
    return snapshot._replace(card=CARDS.get(changes.get("stage")), newest=newest)._replace(**changes)


def running(over: int = 0, **changes) -> m.Snapshot:
    """The trial after so many of the plan is running."""
    following = PLAN[over + 1] if over + 1 < len(PLAN) else None
    checks = tuple(check._replace(text="on") if check.name == "Recording" else check for check in GREEN)
    snapshot = ready(over)._replace(stage=m.RUNNING, running=PLAN[over], coming=following, checks=checks)
    return snapshot._replace(**changes)


def pulse(name: str = "run-001") -> m.Pulse:
    """Proof in the middle of a trial."""
    proof = m.Proof(name, 18_412, 4_200_000, 0.1) if name else None
    return m.Pulse(proof, 22)


def ticks(phase: int, n: int = 16, taken: bool = True, start: float = 0.0, **columns: float) -> np.ndarray:
    """n rows of the tick log in one phase; columns by their names in core.tick_log."""
    rows = np.zeros((n, tick_log.WIDTH))
    rows[:, tick_log.T] = start + 1e-3 * np.arange(n)
    rows[:, tick_log.PHASE], rows[:, tick_log.TRAVEL_SENSE] = phase, 1.0
    rows[:, tick_log.TIP_X], rows[:, tick_log.TIP_Y] = TIP
    for name, value in columns.items():
        rows[:, getattr(tick_log, name)] = value
    rows[:, tick_log.TARGET_X], rows[:, tick_log.TARGET_Y] = rows[:, tick_log.TIP_X], rows[:, tick_log.TIP_Y]
    if taken:
        rows[:, tick_log.TARGET_X] += 0.02
    return rows


def movement(path: int, brakes: str, seconds: float = 3.0, total: float = 4.0) -> np.ndarray:
    """Ticks of a plausible movement along a segment: the first seconds of one that takes `total`."""
    t = np.arange(0.0, seconds, 1e-3)
    rows = np.zeros((len(t), tick_log.WIDTH))
    (x0, y0), (x1, y1) = PATHS[path].start_m, PATHS[path].end_m
    share = np.clip(t / total, 0.0, 1.0)
    along = 10 * share**3 - 15 * share**4 + 6 * share**5
    off = 0.004 * np.sin(2 * math.pi * 0.7 * t) * along**0.3
    length = math.hypot(x1 - x0, y1 - y0)
    rows[:, tick_log.T], rows[:, tick_log.PHASE] = t, tick_log.MOVE
    rows[:, tick_log.TIP_X] = x0 + along * (x1 - x0) - off * (y1 - y0) / length
    rows[:, tick_log.TIP_Y] = y0 + along * (y1 - y0) + off * (x1 - x0) / length
    rows[:, tick_log.TIP_VX], rows[:, tick_log.TIP_VY] = (
        np.gradient(rows[:, i], t) for i in (tick_log.TIP_X, tick_log.TIP_Y)
    )
    rows[:, tick_log.HAND_FX] = 4.0 + 2.0 * np.sin(5.0 * t)
    rows[:, tick_log.HAND_FY] = 2.0 * np.cos(3.0 * t)
    rows[:, tick_log.TARGET_X] = rows[:, tick_log.TIP_X] + 0.006 * rows[:, tick_log.HAND_FX]
    rows[:, tick_log.TARGET_Y] = rows[:, tick_log.TIP_Y] + 0.006 * rows[:, tick_log.HAND_FY]
    for i, joint in enumerate("AEBC"):
        if joint in brakes:
            rows[:, tick_log.CURRENT + i] = np.where(np.floor(3.0 * t + 0.7 * i) % 3 == 0, 0.4 + 0.15 * i, 0.0)
            rows[:, tick_log.TORQUE + i] = np.where(rows[:, tick_log.CURRENT + i] > 0, 2.0 + i, 0.4)
    rows[:, tick_log.PATH_DISTANCE], rows[:, tick_log.TRAVEL_SENSE] = off, 1.0
    rows[:, tick_log.FORWARD_X], rows[:, tick_log.FORWARD_Y] = (x1 - x0) / length, (y1 - y0) / length
    rows[:, tick_log.STUCK] = np.where(rows[:, tick_log.CURRENT + 1] > 0, 2, 0)
    rows[:, tick_log.LATENESS_US] = 12.0 + 20.0 * np.random.default_rng(1).random(len(t)) ** 6
    work = np.cumsum(np.hypot(rows[:, tick_log.HAND_FX], rows[:, tick_log.HAND_FY])) * 1e-3 * 0.05
    rows[:, tick_log.ENERGY_HAND], rows[:, tick_log.ENERGY_BRAKES] = work, 0.85 * work
    rows[:, tick_log.ENERGY_KINETIC] = work - rows[:, tick_log.ENERGY_BRAKES]
    return rows
