"""The conductor's desk: the whole state of the experiment, and what becomes of a trial when it ends.

`intents` changes it as a window asks; `snapshot` shows it.
"""

import statistics
import threading
import time
from collections.abc import Callable

from app.live import messages as m
from app.live.before_protocol import Protocol, Session, load_protocol, new_trial, unfinished_sessions
from app.live.checks import check_device, check_disk, check_hand, check_recording
from app.live.loop_process import LoopProcess
from app.live.ring import Ring
from app.live.runner import Runner
from app.live.setup import Setup
from app.live.trial_run import TrialRun, tip_of
from core.errors import InputError
from core.simulator import Simulation
from experiments.plan import PlannedTrial, plan_hash
from experiments.session import write_pooled_table
from experiments.trial import Trial, new_simulation

DISK_S = 5.0  # between two looks at the disk, while nothing runs
END_S = 5.0  # longest wait for a trial to end by itself when the conductor ends
WAIT_S = 0.01


class Desk:
    """One data folder, one session at a time, one trial at a time."""

    def __init__(self, setup: Setup, ring: Ring, loop: LoopProcess) -> None:
        self.setup, self.ring = setup, ring
        self.runner = Runner(ring, loop, setup.real_time)
        self.protocol: Protocol | None = None  # None: still being read
        self.session: Session | None = None
        self.coming: PlannedTrial | None = None
        self.rigged = ""  # the configuration that stands on the bench
        self.rested_at = -1  # trials that were settled when the last break ended
        self.asked_block: tuple[str, int] | None = None  # configuration and block whose questions wait for answers
        self.paused_s: float | None = None  # since when
        self.why_off = ""  # cause of the brakes-off, as the journal has it
        self.notes: list[str] = []
        self.broken = ""  # why no more trials can be run
        self.practised = 0  # trials without a session
        self.last_end_s: float | None = None  # of a trial; None: what comes next is not one trial's length away
        self.rest_from_s = 0.0  # when the last trial ended, or the session was opened
        self._lengths: list[float] = []  # s, from the end of one trial to the end of the next
        self._said, self._said_bad = "", False
        self._tip: m.Point = (0.0, 0.0)
        self._verified = ""  # the last recording
        self._resumable: tuple[str, ...] = ()
        self._disk, self._free = check_disk(setup.data_dir)
        self._looked_s = time.monotonic()
        self._bench: Simulation | None = None  # for practice without a session
        self._failure: BaseException | None = None
        self._preparation = threading.Thread(target=self._prepare, name="preparation", daemon=True)
        self._preparation.start()

    def _prepare(self) -> None:
        """Read the protocol and build the simulated device, beside the conductor's own work."""
        setup = self.setup
        try:
            protocol = load_protocol(
                setup.protocol, devices=setup.devices, rules=setup.rules, low_gain=setup.low_gain, seed=setup.seed
            )
            self._resumable = tuple(unfinished_sessions(setup.data_dir))
            place = next(iter(protocol.paths.values())).start_m
            self._bench = new_simulation(protocol.devices[0], place, protocol.mouse.hand())
            self._tip, self.protocol = place, protocol
        except InputError as error:
            self.broken = str(error)
        except BaseException as error:
            self._failure = error  # raised again where it ends the conductor

    def practice_trial(self, planned: PlannedTrial) -> Trial:
        """A trial that no session knows of, on the protocol's first device."""
        p = self.protocol
        assert p is not None and self._bench is not None
        return new_trial(
            self._bench, planned, p.paths[planned.segment], p.controllers[planned.controller], p.rules, p.trial
        )

    # ------------------------------------------------------------------------------------- what is

    @property
    def stage(self) -> str:
        """Where the session is."""
        if self.broken:
            return m.FAILED
        if self.runner.run is not None:
            return m.RUNNING
        if self.protocol is None or not self.runner.ready:
            return m.PREPARING
        if self.session is None:
            return m.NO_SESSION
        if self.asked_block is not None:
            return m.QUESTIONS
        if self.coming is None:
            return m.FINISHED
        if self.coming.configuration != self.rigged:
            return m.RERIG
        if self.session.break_due and self.session.settled != self.rested_at:
            return m.BREAK
        return m.READY

    def opened(self) -> m.Opened | None:
        """What does not change while a session is open; None: not known yet."""
        protocol, session = self.protocol, self.session
        if protocol is None:
            return None
        return m.Opened(
            participant=session.participant if session else "",
            protocol=protocol.name,
            devices=tuple(protocol.devices),
            paths=dict(protocol.paths),
            controllers=dict(protocol.controllers),
            plan=tuple(session.plan) if session else (),
            plan_sha256=plan_hash(session.plan) if session else "",
            folder=str(session.folder if session else self.setup.data_dir),
            note=protocol.note(),
            feedback=protocol.feedback,
            show_linkage=protocol.show_linkage,
            cues=(protocol.cues.too_fast_s, protocol.cues.too_slow_s) if protocol.cues else None,
            seed=protocol.seed,
            real_device=False,
        )

    def snapshot(self) -> m.Snapshot:
        """Everything that a window shows."""
        stage, session, run = self.stage, self.session, self.runner.run
        at = run.planned if run else self.coming
        return m.Snapshot(
            stage=stage,
            rows=tuple(session.rows) if session else (),
            coming=self.coming,
            running=run.planned if run else None,
            practice=session is None or (at is not None and at.block == 0),
            tip=self._tip,
            paused=self.paused_s is not None,
            blind=session is not None and session.blind,
            checks=(
                check_device(True, self.why_off),
                check_hand(self.setup.hand),
                self.runner.check,
                self._disk,
                check_recording(self.broken, self._verified),
            ),
            brakes_off=self.why_off,
            notes=tuple(self.notes),
            said=self._said,
            said_bad=self._said_bad,
            wait_for=self._wait_for(stage),
            wait_s=session.protocol.breaks.least_s if session and stage == m.BREAK else 0.0,
            seconds_left=self._seconds_left(),
            resumable=() if session else self._resumable,
        )

    def pulse(self) -> m.Pulse:
        """Proof of recording, and timing."""
        run = self.runner.run
        verified = sum(bool(row.recording) for row in self.session.rows) if self.session else 0
        return m.Pulse(run.recorder.proof() if run else None, self.runner.timing, verified, self._free)

    def _wait_for(self, stage: str) -> str:
        if stage == m.BREAK:
            return "A break: let go of the handle and rest."
        if stage != m.RERIG:
            return ""
        assert self.protocol is not None and self.coming is not None
        device = self.protocol.device(self.coming.configuration)
        joints = " ".join(device.braked)
        return f"Next: {device.name} (brakes at {joints}). The device is simulated: there is nothing to change by hand."

    def _seconds_left(self) -> float | None:
        if self.session is None or not self._lengths:
            return None
        return statistics.median(self._lengths) * (len(self.session.plan) - self.session.settled)

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

    def watch(self) -> None:
        """Take in what has happened since the last time."""
        if self._failure is not None:
            raise self._failure
        if (why_off := self.ring.why_off) != self.why_off:
            self.why_off = why_off
            self.write("brakes off", cause=why_off)
        run, lost = self.runner.watch()
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
        outcome = run.trial.outcome()
        said = f"Run {run.planned.run}: {outcome['reason']}." if outcome["reason"] else ""
        self._tip = tip_of(run.trial)
        if run.recorder.writer is None or self.session is None:
            self.say(said.replace("Run 0", "Practice"), bad=False)
            return
        try:
            row = run.keep(self.session)
            self._verified = row.recording.rsplit("/", 1)[-1] or self._verified
            self.changed(said)
        except (InputError, OSError) as error:
            self.broken = f"Run {run.planned.run} is not complete: {error}"
            self.say(self.broken, bad=True)
            return
        now, planned = time.monotonic(), run.planned
        if self.last_end_s is not None:
            self._lengths.append(now - self.last_end_s)
        self.last_end_s = self.rest_from_s = now
        block = (planned.configuration, planned.block)
        next_block = (self.coming.configuration, self.coming.block) if self.coming else None
        if self.session.protocol.questionnaire and planned.block and next_block != block:
            self.asked_block = block

    def _lost(self, run: TrialRun | None, why: str) -> None:
        """The loop died or hung, perhaps with a trial."""
        self.broken = self.runner.broken
        said = f"{why[0].upper()}{why[1:]}."
        if run is not None:
            try:
                run.rescue(self.session, self.setup.sync)
                self.write("control loop lost", run=run.planned.run, reason=why)
                if run.recorder.writer is not None:
                    self.changed(said)
                    said += f" Run {run.planned.run} is recovered and its trial comes again."
            except (InputError, OSError) as error:
                self.broken = f"{why}; run {run.planned.run} could not be recovered: {error}"
                said = self.broken
        self.last_end_s = None
        self.say(said, bad=True)

    def changed(self, said: str) -> None:
        """A row has been added or marked: the tables, what comes, and what to say of it. OSError, InputError."""
        write_pooled_table(self.setup.data_dir)
        self.look_ahead()
        self.say(said)

    def look_ahead(self) -> None:
        """What comes, and where the handle stands then."""
        assert self.session is not None and self.protocol is not None
        self.coming = self.session.next_planned()
        configuration = self.coming.configuration if self.coming else self.rigged
        x, y = self.session.simulation(configuration or self.protocol.devices[0].name).state["tip"][0, :2]
        self._tip = (float(x), float(y))

    def end(self, reason: str) -> None:
        """Abort what runs, keep it, let the session go, end the loop."""
        if self.runner.run is not None:
            self.runner.run.stop(reason)
        deadline = time.monotonic() + END_S
        while self.runner.run is not None and time.monotonic() < deadline:
            self.ring.beat()
            self.watch()
            time.sleep(WAIT_S)
        self.runner.close()
        if self.runner.run is not None:
            self.runner.run.rescue(self.session, self.setup.sync)
        if self.session is not None:
            self.session.close()
