"""The conductor's desk: the whole state of the experiment, and what becomes of a trial when it ends.

`intents` changes it as a window asks; `snapshot` shows it.
"""

import threading
import time
from collections.abc import Callable

import numpy as np

from app.live import messages as m
from app.live.checks import check_disk, check_recording
from app.live.loop_process import LoopProcess
from app.live.rigging import Rigging
from app.live.ring import Ring
from app.live.runner import Runner
from app.live.setup import OPERATOR, Setup
from app.live.simulated_device import SimulatedDevice
from app.live.sitting import Sitting
from app.live.trial_run import TrialRun
from core.control import NO_CONTROL
from core.errors import InputError
from core.path_file import build_path
from core.simulator import Simulation
from experiments.person import Person
from experiments.plan import PlannedTrial, participant_index
from experiments.population import load_population
from experiments.protocol import Protocol
from experiments.session import Session
from experiments.session_files import free_participant, unfinished_sessions, write_pooled_table
from experiments.trial import Trial, new_simulation

DISK_S = 5.0  # between two looks at the disk, while nothing runs
END_S = 5.0  # longest wait for a trial to end by itself when the conductor ends
WAIT_S = 0.01


class Desk:
    """One data folder, one session at a time, one trial at a time."""

    def __init__(self, setup: Setup, protocol: Protocol, ring: Ring, loop: LoopProcess) -> None:
        """protocol: of new sessions. loop: already started."""
        self.setup, self.protocol, self.ring = setup, protocol, ring
        self.runner = Runner(ring, loop, setup.real_time, setup.link)
        self.device = Rigging(self.runner.send, protocol) if setup.link else SimulatedDevice(ring, setup.hand)
        self.sitting: Sitting | None = None  # the open session
        self.why_off = ""  # cause of the brakes-off, as the journal has it
        self.broken = ""  # why no more trials can be run
        self.tried = 0  # practice trials without a session
        self._said, self._said_bad = "", False
        self._verified = ""  # what was recorded last
        self._resumable: tuple[str, ...] = ()
        self._next_participant = ""
        self.look_for_participants()
        self._next_participant = setup.participant or self._next_participant
        self._disk, self._free = check_disk(setup.data_dir)
        self._looked_s = time.monotonic()
        self._bench: Simulation | None = None  # for practice without a session
        self._failure: BaseException | None = None
        self._loop_ready = threading.Event()
        self._preparation = threading.Thread(target=self._prepare, name="preparation", daemon=True)
        self._preparation.start()

    def _prepare(self) -> None:
        """Build the simulated device, whose kernels may have to be compiled, beside the conductor's own work."""
        protocol = self.protocol
        try:
            start = build_path(next(iter(protocol.paths.values())), "path")
            hand = None if self.setup.hand == OPERATOR else protocol.mouse.hand()
            self._bench = new_simulation(protocol.devices[0], (start.x0, start.y0), hand)
            self._loop_ready.wait()  # which needs the processors more
            import scipy.fft
            import scipy.signal  # noqa: F401  (the measures need them: seconds, but not after the first trial)
        except BaseException as error:
            self._failure = error  # raised again where it ends the conductor

    def look_for_participants(self) -> None:
        """Whose session can be gone on with, and who has none yet."""
        self._resumable = tuple(unfinished_sessions(self.setup.data_dir))
        try:
            self._next_participant = free_participant(self.setup.data_dir, self.protocol.participants)
        except InputError:
            self._next_participant = next(iter(self._resumable), "")

    def person(self, participant: str) -> Person | None:
        """The simulated operator that has this participant's place, if one moves the handle."""
        if self.setup.hand != OPERATOR:
            return None
        seeds = np.random.SeedSequence([self.protocol.seed, participant_index(participant)])
        return load_population().draw(np.random.default_rng(seeds))

    def try_out(self) -> Trial:
        """A practice trial that no session knows of, on the protocol's first device.

        Our choice: it goes through the controllers, those that brake first, and through the paths.
        """
        p = self.protocol
        assert self._bench is not None
        turn, numbers = self.tried, list(p.paths)
        controllers = sorted(p.controllers, key=lambda number: p.controllers[number].algorithm == NO_CONTROL)
        controller, segment = controllers[turn % len(controllers)], numbers[turn % len(numbers)]
        self.tried += 1
        self.device.take_handle(self._bench)
        return Trial(
            self._bench, PlannedTrial(0, 0, p.devices[0].name, controller, segment, self.tried), p.paths[segment],
            p.controllers[controller], p.rules, p.trial, self.person("0"), np.random.default_rng(turn),
        )  # fmt: skip

    # ------------------------------------------------------------------------------------- what is

    @property
    def stage(self) -> str:
        """Where the session is."""
        if self.broken:
            return m.FAILED
        if self.runner.run is not None:
            return m.RUNNING
        if self._bench is None or not self.runner.ready:
            return m.PREPARING
        return self.device.stage(self.sitting) if self.sitting else m.NO_SESSION

    @property
    def session(self) -> Session | None:
        """The open one."""
        return self.sitting.session if self.sitting else None

    def opened(self) -> m.Opened:
        """What does not change while a session is open."""
        session = self.session
        protocol = session.protocol if session else self.protocol
        return m.Opened(
            participant=session.participant if session else "",
            protocol=protocol.name,
            devices=tuple(protocol.devices),
            paths=dict(protocol.paths),
            controllers=dict(protocol.controllers),
            plan=tuple(session.plan) if session else (),
            plan_sha256=session.plan_sha256 if session else "",
            folder=str(session.folder if session else self.setup.data_dir),
            note=protocol.note(),
            feedback=protocol.feedback,
            show_linkage=protocol.show_linkage,
            cues=(protocol.cues.too_fast_s, protocol.cues.too_slow_s) if protocol.cues else None,
            seed=protocol.seed,
            real_device=self.device.real,
            hand=self.device.hand,
            next_participant=self._next_participant,
            rules=protocol.rules,
        )

    def snapshot(self) -> m.Snapshot:
        """Everything that a window shows."""
        stage, sitting, session, run = self.stage, self.sitting, self.session, self.runner.run
        coming = sitting.coming if sitting else None
        at = run.planned if run else coming
        return m.Snapshot(
            stage=stage,
            rows=tuple(session.rows) if session else (),
            coming=coming,
            running=run.planned if run else None,
            practice=session is None or (at is not None and at.block == 0),
            tip=self._tip(),
            paused=sitting is not None and sitting.paused_s is not None,
            blind=session is not None and session.blind,
            checks=(
                *self.device.checks(self.why_off),
                self.runner.check,
                self._disk,
                check_recording(self.broken, self._verified),
            ),
            brakes_off=self.why_off,
            notes=tuple(sitting.notes) if sitting else (),
            said=self._said,
            said_bad=self._said_bad,
            wait_for=self.device.wait_for(sitting) if sitting and stage in (m.RERIG, m.BREAK) else "",
            wait_s=session.protocol.breaks.least_s if session and session.protocol.breaks and stage == m.BREAK else 0.0,
            seconds_left=sitting.seconds_left() if sitting else None,
            resumable=() if session else self._resumable,
        )

    def pulse(self) -> m.Pulse:
        """Proof of recording, and timing."""
        proof = self.runner.run.recorder.proof() if self.runner.run else None
        verified = sum(bool(row.recording) for row in self.session.rows) if self.session else 0
        return m.Pulse(proof, self.runner.timing, verified, self._free, self.device.linked)

    def _tip(self) -> m.Point:
        """Where the handle stands; during a trial: where it stood before, m."""
        if self.runner.run is not None:
            return self.runner.run.tip
        return self.device.tip(self.sitting, self._bench)

    # ------------------------------------------------------------------------------------- what happens

    def say(self, sentence: str, bad: bool = False) -> None:
        """Tell the experimenter."""
        self._said, self._said_bad = sentence, bad

    def write(self, event: str, **about: object) -> None:
        """A line in the journal of the session, if there is one; never while the control loop waits for us."""
        session = self.session
        if session is None:
            return
        try:
            self.beside(lambda: session.journal(event, **about))
        except OSError as error:
            self.broken = f"The journal of {session.folder} takes no more: {error.strerror or error}"
            self.say(self.broken, bad=True)

    def beside(self, write: Callable[[], None]) -> None:
        """Write to the disk: by the recorder while a trial runs, for a slow disk must not silence us."""
        if self.runner.run is not None:
            self.runner.run.recorder.beside(write)
        else:
            write()

    def look_at_brakes(self) -> None:
        """Whether currents may flow; what has changed is journalled."""
        if (why_off := self.ring.why_off) != self.why_off:
            self.why_off = why_off
            self.write("brakes off" if why_off else "brakes allowed", **({"cause": why_off} if why_off else {}))

    def watch(self) -> None:
        """Take in what has happened since the last time."""
        if self._failure is not None:
            raise self._failure
        self.look_at_brakes()
        run, lost = self.runner.watch()
        self.device.hear(self.runner, self.write, self.say)
        if self.runner.ready:
            self._loop_ready.set()
        if lost:
            self._lost(run, lost)
        elif run is not None:
            self._keep(run)
        now = time.monotonic()
        if self.runner.run is None and now - self._looked_s > DISK_S:
            self._looked_s = now
            self._disk, self._free = check_disk(self.setup.data_dir)

    def _keep(self, run: TrialRun) -> None:
        """A trial has come to its end."""
        reason = run.trial.outcome()["reason"]
        said = f"{run.name}: {reason}." if reason else ""
        if self.sitting is None:
            self.say(said)
            return
        try:
            row = run.keep(self.sitting.session)
            self._verified = run.name.lower() if row.recording else self._verified
            self.changed(said)
            self.sitting.trial_ended()
        except (InputError, OSError) as error:
            self.broken = f"{run.name} is not complete: {error}"
            self.say(self.broken, bad=True)

    def _lost(self, run: TrialRun | None, why: str) -> None:
        """The loop died or hung, perhaps with a trial."""
        self.broken = self.runner.broken
        said = f"{why[0].upper()}{why[1:]}."
        if run is not None:
            try:
                run.rescue(self.session, self.setup.sync)
                self.write("control loop lost", run=run.planned.run, reason=why)
                if run.recorder.writer is not None:
                    said += f" {run.name} is recovered and its trial comes again."
                    self.changed(said)
            except (InputError, OSError) as error:
                self.broken = f"{why}; {run.name.lower()} could not be recovered: {error}"
                said = self.broken
        if self.sitting is not None:
            self.sitting.last_end_s = None
        self.say(said, bad=True)

    def changed(self, said: str) -> None:
        """A row has been added or marked: what comes, the table of all participants, and what to say. OSError."""
        assert self.sitting is not None
        self.sitting.look_ahead()
        self.say(said)
        try:
            write_pooled_table(self.setup.data_dir)
        except InputError as error:  # another session's table cannot be read: this one goes on
            self.say(f"{said} The table of all participants was not rewritten: {error}.".strip(), bad=True)

    def end(self, reason: str) -> None:
        """Abort what runs, keep it, let the session go, end the loop."""
        if self.runner.run is not None:
            self.runner.run.stop(reason)
        deadline = time.monotonic() + END_S
        while self.runner.run is not None and time.monotonic() < deadline:
            self.ring.beat()
            self.watch()
            time.sleep(WAIT_S)
        self.device.close()
        self.runner.close()
        if self.runner.run is not None:
            self.runner.run.rescue(self.session, self.setup.sync)
        if self.session is not None:
            self.session.close()
