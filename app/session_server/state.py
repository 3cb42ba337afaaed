"""The state of the session server: the open session, the device, the running trial.

`commands` change it, `snapshot` shows it, `storage` writes it to the disk.
"""

import time
from collections.abc import Callable

from app.ipc import messages as m
from app.ipc.messages import BAD, Setup
from app.ipc.ring import Ring
from app.session_server.device_setup import RealSetup, SimulatedSetup
from app.session_server.loop_process import LoopProcess
from app.session_server.lsl import Outlets
from app.session_server.preflight import SLOW_SYNC_S, DiskWatch, check_recording, with_advice
from app.session_server.sandbox import Sandbox
from app.session_server.steps import due_step, stage_of
from app.session_server.storage import Storage
from app.session_server.trial_runner import TrialRun, TrialRunner
from experiments.inputs import is_person
from experiments.protocol import Protocol
from experiments.store.journal import BRAKES_ALLOWED, BRAKES_OFF, WINDOW_LOST

END_S = 5.0  # longest wait for a trial to end by itself when the session server ends
WAIT_S = 0.01


class ServerState:
    """The state of the session server: one session and one trial at a time."""

    def __init__(
        self, setup: Setup, protocol: Protocol, ring: Ring, loop: LoopProcess, lsl: Outlets | None = None
    ) -> None:
        """protocol: of new sessions. loop: already started. lsl: streams for other recorders; None: not asked for."""
        self.lsl = lsl
        self.setup, self.protocol, self.ring = setup, protocol, ring
        self.runner = TrialRunner(ring, loop, setup.real_time, setup.link)
        self.device = RealSetup(protocol, self.runner.send) if setup.link else SimulatedSetup(ring, setup.hand)
        self.why_off = ""  # cause of the brakes-off, as the journal has it
        self.presses = 0  # of the brakes-off, as the window has seen them
        self.broken = ""  # why no more trials can be run
        self.storage = Storage(self.runner, self.notify)
        self._notice, self._notice_bad = "", False
        self._device_bad = False
        self._disk = DiskWatch(setup.data_dir)
        self._slow_s = 0.0  # the longest that the disk made the last trial wait for one write
        self._waits_for = ""  # the notice while a slow disk is waited for
        self.show: Callable[[], None] = lambda: None  # shows everything to the window, now
        self.sandbox = Sandbox(setup, protocol, self.runner, self.device, self.notify)

    # ------------------------------------------------------------------------------------- what the window shows

    @property
    def stage(self) -> str:
        """The stage of the session server, of `messages`: `PREPARING` and others."""
        if self.broken:
            return m.FAILED
        if self.runner.run is not None:
            return m.RUNNING
        if not self.sandbox.prepared or not self.runner.ready or not self._disk.known:
            return m.PREPARING
        return stage_of(self.storage.progress, self.device) if self.storage.progress else m.NO_SESSION

    def opened(self) -> m.Opened:
        """What does not change while a session is open."""
        session = self.storage.progress.session if self.storage.progress else None
        protocol = session.protocol if session else self.protocol
        return m.Opened(
            participant=session.participant if session else "",
            protocol=protocol,
            plan=tuple(session.plan) if session else (),
            plan_sha256=session.plan_sha256 if session else "",
            folder=str(session.folder if session else self.setup.data_dir),
            real_device=self.device.real,
            hand=self.device.hand,
            blind=protocol.blind and is_person(self.setup.hand),
        )

    def snapshot(self) -> m.Snapshot:
        """Everything that the window shows."""
        stage, progress, run = self.stage, self.storage.progress, self.runner.run
        session = progress.session if progress else None
        coming = progress.coming if progress else None
        due = due_step(progress, self.device) if progress else None
        at = run.planned if run else coming
        recording = check_recording(self.broken, self.storage.not_written, self.storage.verified)
        if self._waits_for:
            recording = m.Check("Recording", m.WAITING, "waiting for the disk", self._waits_for)
        return m.Snapshot(
            stage=stage,
            rows=tuple(session.rows) if session else (),
            coming=coming,
            running=run.planned if run else None,
            practice=session is None or (at is not None and at.block == 0),
            tip=run.tip if run else self.device.tip(progress, self.sandbox.simulation),
            paused=progress is not None and progress.paused_s is not None,
            blind=session is not None and session.blind,
            checks=(
                *self.device.checks(self.why_off),
                self.runner.check,
                self._disk.check,
                recording,
            ),
            brakes_off=self.why_off,
            notes=tuple(progress.notes) if progress else (),
            notice=self._waits_for or self._notice,
            notice_bad=self._notice_bad and not self._waits_for,
            sandbox=self.sandbox.state,
            card=due[1] if due and stage == due[0].name else None,
            step=self.device.doing,
            seconds_left=progress.seconds_left() if progress else None,
            newest=progress.newest if progress else None,
            not_written=self.storage.not_written,
            in_memory=self.storage.in_memory,
        )

    def pulse(self) -> m.Pulse:
        """The proof of recording, and the device."""
        proof = self.runner.run.recorder.proof() if self.runner.run else None
        rows = self.storage.progress.session.rows if self.storage.progress else []
        verified = sum(bool(row.recording) for row in rows)
        return m.Pulse(proof, verified, self.device.status)

    # ------------------------------------------------------------------------------------- what happens meanwhile

    def notify(self, sentence: str, bad: bool = False) -> None:
        """Show the experimenter a sentence."""
        self._notice, self._notice_bad = sentence, bad

    def announce_wait(self, reason: str) -> None:
        """Show the experimenter, before it happens, that the disk will take long. reason: "the trial is opened"."""
        if self._disk.slow or self._slow_s > SLOW_SYNC_S:
            self._waits_for = f"{m.DISK_WAIT}: {reason}."
            self.show()
            self._waits_for = ""

    def clear_refusal(self) -> None:
        """Remove the notice of an earlier refusal: a new command is done."""
        if self._notice_bad:
            self.notify("")
            self.show()  # the same refusal once more is another one

    def journal_brakes(self) -> None:
        """Write a change of the brakes-off into the journal."""
        self.presses = self.ring.presses
        if (why_off := self.ring.why_off) != self.why_off:
            self.why_off = why_off
            if why_off:
                self.storage.write(BRAKES_OFF, cause=why_off)
            else:
                self.storage.write(BRAKES_ALLOWED)

    def _note_device_back(self) -> None:
        """Say of a device that was lost that it is back; what it stopped, and why, can still be read."""
        check = self.device.checks(self.why_off)[0]
        before, self._device_bad = self._device_bad, check.state == BAD
        if before and not self._device_bad:
            self.notify(f"{self._notice} The device is ready again." if self._notice and self.device.real else "")

    def window_lost(self) -> None:
        """Leave Try and journal that the window is gone."""
        self.sandbox.leave()
        self.storage.write(WINDOW_LOST)

    def watch(self) -> None:
        """Handle everything that has happened since the last call."""
        if self.sandbox.failure is not None:
            raise self.sandbox.failure
        if self.lsl is not None and self.lsl.failure:
            self.notify(self.lsl.failure, bad=True)
            self.lsl = None
        self.journal_brakes()
        run, lost = self.runner.watch()
        if isinstance(self.device, RealSetup):
            self.device.take_answers(self.runner.device_answers(), self.storage.write, self.notify)
        self._note_device_back()
        if self.runner.ready:
            self.sandbox.loop_ready.set()
        if lost:
            self._handle_lost_loop(run, lost)
        elif run is not None and self.sandbox.owns(run):
            self.sandbox.returned(run, self.ring.grasp)
        elif run is not None:
            self._slow_s = run.recorder.longest_sync_s
            self.announce_wait(f"{self.storage.open.name_of(run.planned).lower()} is stored")
            self.storage.store_trial(run)
        elif self.runner.run is not None and not self.sandbox.owns(self.runner.run):
            self.storage.watch(self.runner.run)
        self.sandbox.watch(self.snapshot().trial_blocker if self.sandbox.wants_pass else "")
        if self.runner.run is None:
            self._disk.watch()
            self.storage.retry()

    def _handle_lost_loop(self, run: TrialRun | None, why: str) -> None:
        """Handle a loop that died or hung, perhaps with a trial."""
        self.broken = self.runner.broken
        if isinstance(self.device, RealSetup) and not self.broken:
            self.device.reconnect()
        if run is not None and not self.sandbox.owns(run):
            self.storage.store_trial(run, why)
        else:
            self.sandbox.lost()
            self.notify(with_advice("", why), bad=True)

    def end(self, reason: str) -> None:
        """Abort and store the running trial, close the session, end the loop."""
        self.sandbox.leave()
        if self.runner.run is not None:
            self.runner.run.stop(reason)
        deadline = time.perf_counter() + END_S
        while self.runner.run is not None and time.perf_counter() < deadline:
            self.ring.beat()
            self.watch()
            time.sleep(WAIT_S)
        self.device.close()
        self.runner.close()
        if self.runner.run is not None:
            self._handle_lost_loop(self.runner.run, reason)
        if left := self.storage.end():
            self.broken = left
            self.notify(f"{left}.", bad=True)
