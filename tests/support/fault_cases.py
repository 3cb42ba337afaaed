"""Faults, and a trial in simulated time that they are brought upon: the real loop, link, trial, run and session, in one
process, over a board whose time is ours. What the fault matrix is made of."""

import io
import math
import pickle
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
from fault_kinds import AWAY, BETWEEN, END, LOCKED_TICKS, PULL, START, Fault, Killed
from real_bench import RealBench
from simulated_bench import BenchWire, TcpWire

from app.ipc.jobs import HomeAt, Reset, TrialReturned
from app.ipc.messages import GOOD, DeviceStatus
from app.ipc.ring import Ring
from app.loop.loop import Loop
from app.session_server.preflight import check_real, with_advice
from app.session_server.trial_runner import TrialRun
from core import tick_log
from core.device import load_device
from core.device_interface import ZeroRecord
from core.faults import cause
from experiments.protocol import Protocol, load_protocol
from experiments.recording import Sensors
from experiments.store.cells import trial_name
from experiments.store.recording import read_recording
from experiments.store.session import Participant, Session
from experiments.trial.real_trial import RealTrial
from hardware.emulated_board.board import Board
from hardware.emulated_board.device import HeldHand
from hardware.serial_device import SerialDevice
from hardware.wire.messages import State

PROTOCOL = """
name = "faults"
devices = ["four-brake", "four-encoders.toml"]
rules = "literal"
blocks = 100
path = [{{number = 1, kind = "segment", start_m = [{0}, {1}], end_m = [{2}, {3}]}}]
controller = [{{number = 1, name = "Locks", kind = "proportional", gain_N_s_m = 5.0}}]
[trial]
hold_s = 0.04
start_radius_m = 0.008
end_radius_m = 0.006
time_out_s = 3.0
end_s = 0.1
[release]
force_N = 30.0
time_s = 0.1
"""


def fault_protocol(folder: Path) -> Protocol:
    """A short trial whose controller locks when pulled away; the second device has four encoders."""
    shipped = load_device("four-brake")
    text = shipped.text.replace("A = 96000", "A = 96000, E = 96000, C = 96000")
    text = text.replace('name = "four-brake"', 'name = "four-encoders"')
    (folder / "four-encoders.toml").write_text(text)
    (folder / "faults.toml").write_text(PROTOCOL.format(*START, *END))
    return load_protocol(str(folder / "faults.toml"))


class Place(NamedTuple):
    """What the cases share: a session, whose recordings are all verified together, and what is left of its plan."""

    folder: Path
    session: Session
    plan: dict[str, list]

    @classmethod
    def make(cls, folder: Path) -> "Place":
        session = Session(folder / "data", Participant("01"), fault_protocol(folder), sync=False)
        names = [device.name for device in session.protocol.devices]
        plan = {name: [t for t in session.plan if t.configuration == name] for name in names}
        return cls(folder, session, plan)


def lost(name: str = "") -> str:
    """What `State` says when the loop is gone."""
    said = with_advice("", cause("loop-died"))
    return f"{said} {name} is recovered and repeated next." if name else said


LEAST_TICKS = 150  # that a link listens before anything happens: its clock model has settled
AT_REST_M, AT_REST_M_S = 1e-3, 1e-3  # the handle has come to rest where the hand holds it


class Case:
    """One trial, or the time between two, with one fault in one phase."""

    def __init__(
        self, place: Place, fault: Fault, phase: str, wire: type[BenchWire | TcpWire] = BenchWire,
        board: type[Board] = Board,
    ) -> None:  # fmt: skip
        self.place, self.fault, self.phase = place, fault, phase
        session = place.session
        device = session.protocol.device(fault.device)
        hand = HeldHand(AWAY if phase == "approach" else START)
        self.bench = RealBench(hand=hand, device=device, wire=wire, board=board)
        self.board = self.bench.board
        self.ring = Ring(width=tick_log.BENCH_WIDTH)
        self.answers = io.BytesIO()
        self.loop = Loop(self.ring, "bench", self.answers, self.bench.now, lambda seconds: None)
        self.loop.device = self.bench.link
        self.bench.link.sensing.set_zero(ZeroRecord(1, (0.0,) * 6, (0.0,) * 6, (0.0,) * 4))
        self.server_lives = True
        self.at = self.seen_ms = self.zero_ms = self.ago_ms = self.ticks = 0
        self.flowing = self.killed = self.past = False
        self.words, self.afterwards, self.again_s = "", "", 0.0
        self.row = None  # of the table
        self.idle(lambda: self.at_rest and self.look() is not None and self.look().state == GOOD)
        self.between() if phase == BETWEEN else self.trial()

    # between trials

    @property
    def at_rest(self) -> bool:
        x, y, vx, vy = self.board.device.motion
        off = np.hypot(*np.subtract((x, y), AWAY if self.phase == "approach" else START))
        return self.board.ticks >= LEAST_TICKS and off < AT_REST_M and np.hypot(vx, vy) < AT_REST_M_S

    def look(self):
        """The device's item of the pre-flight row, by what the loop has told."""
        self.answers.seek(0)
        told_last = None
        while (answer := self.answer()) is not None:
            told_last = answer if isinstance(answer, DeviceStatus) else told_last
        return check_real(told_last, self.ring.why_off) if told_last else None

    def look_now(self):
        """The same, without the 100 ms after which it is told anew."""
        self.idle(lambda: False, 2)
        self.loop.report_device()
        return self.look()

    def answer(self):
        try:
            return pickle.load(self.answers)
        except EOFError:
            return None

    def idle(self, until: Callable[[], bool], most: int = 3000) -> int:
        """The loop between trials; how many ms it took."""
        began = self.board.ticks
        while not until() and self.board.ticks - began < most:
            before = self.board.ticks
            self.loop.idle()
            if self.board.ticks == before:
                self.bench.pass_time(4)
        return self.board.ticks - began

    def between(self) -> None:
        try:
            self.begin_fault()
        except Killed:
            self.killed = True
            self.bench.pass_time(60)
            self.words = lost()
            return

        def seen() -> bool:
            if self.fault.each:
                self.fault.each(self)
            return self.look().state != GOOD

        ms = self.idle(seen, 350)
        self.words = self.look().advice
        self.seen_ms = ms if self.words else 0

    # a trial

    def trial(self) -> None:
        session, planned = self.place.session, self.place.plan[self.fault.device].pop(0)
        sensors = Sensors(self.bench.link.encoders, self.bench.link.force_channels)
        trial, writer = session.begin(planned, sensors)
        sent: list = []
        self.run = TrialRun(self.ring, SimpleNamespace(send=sent.append), trial, writer)
        self.running: RealTrial = pickle.loads(pickle.dumps(sent[0].trial))  # as it comes through the pipe
        self.course = self.steps()
        self.running.exchange = self.exchange
        try:
            self.live()
        except Killed:
            self.killed = True
        except BaseException:
            self.run.recorder.close()
            raise
        self.keep()

    def live(self) -> None:
        self.loop.run(self.running)

    def exchange(self) -> list[np.ndarray]:
        """What the trial does each time, and what we do to it."""
        before = self.board.ticks
        if self.server_lives:
            self.ring.control.server_beat = round(1e9 * self.bench.now())
        made = RealTrial.exchange(self.running)
        if self.board.ticks == before:
            self.bench.pass_time(4)
        self.ticks += len(made)
        assert self.board.ticks < 20_000, "the trial does not end"
        next(self.course, None)
        return made

    def steps(self) -> Iterator[None]:
        trial, hand = self.running, self.bench.hand
        if self.phase == "approach":
            while trial.ticks < 20:
                yield
            hand.obey({"target": list(START)})
        else:
            locked = 0
            while trial.phase == "approach":
                yield
            if self.phase != "hold":
                while trial.phase == "hold":
                    yield
                hand.obey({"target": list(PULL if self.phase == "move" else END)})
                while trial.phase == "move" and (self.phase == "end" or locked < LOCKED_TICKS):
                    locked = locked + 1 if all(self.board.board.currents) else 0
                    yield
            assert trial.phase == self.phase
        self.begin_fault()
        while True:
            over = trial.finished or trial.arguments().run["stop"][0] if self.phase == "end" else trial.phase == "end"
            if not self.seen_ms and over:
                self.seen_ms = self.board.ticks - self.at + self.ago_ms
            if self.phase in self.fault.goes_on and not self.past and self.board.ticks - self.at > 300:
                self.past = True
                hand.obey({"target": list(START)})
                if self.fault.ends:
                    self.fault.ends(self)
            if trial.phase == "move" and self.phase != "move":  # the trial goes on, to its end
                hand.obey({"target": list(END)})
            yield
            if self.fault.each:
                self.fault.each(self)

    def begin_fault(self) -> None:
        self.at = self.board.ticks
        self.flowing = any(self.board.board.currents)
        if self.fault.text:
            self.board.fault(self.fault.text)
        if self.fault.acts:
            self.fault.acts(self)

    def keep(self) -> None:
        """What the session server does with it."""
        self.bench.pass_time(60)
        if self.board.last_current >= self.at:
            self.zero_ms = self.board.last_current + 1 - self.at + self.ago_ms
        session = self.place.session
        if self.killed:
            self.ticks = int(self.ring.control.head)
            self.run.rescue(session)
            self.row = next(r for r in session.rows if r.run == self.run.planned.run)
            self.words = lost(self.name)
            return
        self.run.returned(TrialReturned(self.running.state), "")
        self.words = with_advice(self.name, self.run.trial.outcome()["reason"])
        self.row = self.run.finish(session)

    @property
    def name(self) -> str:
        """As the experimenter reads it."""
        planned, session = self.run.planned, self.place.session
        name = trial_name(planned, session.plan, session.rows) if planned.block else "the practice trial"
        return f"{name[0].upper()}{name[1:]}"

    @property
    def recording(self):
        return read_recording(self.place.session.folder / self.row.recording)

    # and after

    def use_again(self) -> None:
        """What loop and person do when the fault is past, until a trial could begin; the s that it took."""
        self.past = True
        if self.fault.ends:
            self.fault.ends(self)
        self.bench.hand.obey({"target": list(START)})
        self.idle(lambda: not any(self.bench.now() < fault.end_s < math.inf for fault in self.board.faults))
        self.board.faults.clear()
        self.bench.pass_time(20)
        if self.killed:  # the next loop
            self.loop.device = SerialDevice(
                self.bench.device, "bench", clock=self.bench.now, open_port=self.bench.open_port
            )
            self.loop.device.open()
            self.bench.link = self.loop.device
        began, link = self.board.ticks, self.bench.link
        while True:
            assert self.board.ticks - began < 5000, (self.loop.sample, self.ring.why_off, link.problem)
            self.idle(lambda: self.loop.sample is not None and not link.problem)
            self.afterwards = self.afterwards or self.look_now().advice
            sample = self.loop.sample
            if sample.fault or self.ring.why_off:
                self.idle(lambda: bool(self.loop.sample and self.loop.sample.fault and self.ring.why_off), 50)
                self.loop.do(Reset(self.ring.presses))
            elif not sample.homed or not np.allclose(sample.tip, self.board.device.tip, atol=1e-3):
                self.loop.do(HomeAt(self.board.device.tip))
                self.loop.sample = None
            else:
                break
        assert self.look_now().state == GOOD
        self.again_s = 1e-3 * (self.board.ticks - began)

    def close(self) -> None:
        self.bench.link.close()
        assert not any(self.board.board.currents) and self.board.board.state != State.ACTIVE
