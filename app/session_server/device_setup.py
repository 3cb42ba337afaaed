"""A device on the bench, made ready step by step before a configuration's trials: connected, homed, zeroed."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from app.ipc import messages as m
from app.ipc.messages import (
    CONNECT,
    DONE,
    HOME,
    ZERO,
    Connect,
    HomeAt,
    Homed,
    Linked,
    Looked,
    NotDone,
    Reset,
    TakeZero,
    Zeroed,
)
from app.session_server.preflight import check_linked, check_sensor
from app.session_server.session_progress import SessionProgress
from core.device import Device
from core.errors import InputError
from core.simulator.simulation import Simulation
from experiments.plan import PlannedTrial
from experiments.protocol import Protocol, home_of
from experiments.recording.schema import Sensors
from experiments.recording.writer import RecordingWriter
from experiments.session.journal import HOMED, ZEROED
from experiments.session.session import SENSOR, Session
from experiments.trial.linked_trial import LinkedTrial

if TYPE_CHECKING:
    from app.session_server.trial_runner import TrialRunner


class DeviceSetup:
    """How the bench is, as its loop tells it, and what has to be done to it next."""

    real, hand = True, SENSOR

    def __init__(self, send: Callable[[object], None], protocol: Protocol) -> None:
        """send: a job to the loop. protocol: whose devices are looked for at first."""
        self.linked: Linked | None = None  # None: not told yet
        self._send, self._connect = send, Connect(tuple(protocol.devices))
        self._home = home_of(protocol.devices[0], protocol.paths)
        self._busy = False  # a step has been asked for and not been answered
        send(self._connect)

    def stage(self, progress: SessionProgress) -> str:
        """As the session's; but a device has to be made ready, and again after its board has lost its power."""
        stage = progress.stage
        if stage not in (m.READY, m.RERIG) or progress.coming is None:
            return stage
        if self.step(self._device(progress)):
            return m.RERIG
        progress.rigged = progress.coming.configuration
        return progress.stage

    def step(self, device: Device) -> str:
        """What is next before this device can be used. A board that is lost is no step: it comes back itself.

        The loop must have the device as the session has it: the file may be another one by now.
        """
        linked = self.linked or Linked()
        if linked.device != device.name or not any(same(device, one) for one in self._connect.devices):
            return CONNECT
        if linked.problem or linked.fault:
            return DONE
        if not linked.homed:
            return HOME
        return DONE if linked.zeroed else ZERO

    def wait_for(self, progress: SessionProgress) -> str:
        """The step in one sentence."""
        if self.stage(progress) != m.RERIG or progress.coming is None:
            return progress.wait_for()
        device = self._device(progress)
        if self._busy:
            return "A moment ..."
        match self.step(device):
            case "connect":
                joints = " ".join(device.braked)
                return f"Put {device.name} on the bench (brakes at {joints}), connect its board, then go on."
            case "home":
                x, y = home_of(device, progress.session.protocol.paths)
                return f"Hold the handle in its jig at x = {1e3 * x:.0f} mm, y = {1e3 * y:.0f} mm, then go on."
            case "zero":
                return "Let go of the handle, go on, and do not touch it for a second."
        return ""

    def confirm(self, progress: SessionProgress, write: Callable[..., None]) -> None:
        """The person has done it: now the loop does its part."""
        self.do(progress, self.step(self._device(progress)))

    def do(self, progress: SessionProgress, step: str) -> None:
        """Let the loop do a step, or do it again; while one is being done, nothing."""
        device = self._device(progress)
        if step and not self._busy:
            home = HomeAt(home_of(device, progress.session.protocol.paths))
            job = {CONNECT: Connect((device,)), HOME: home, ZERO: TakeZero()}[step]
            if isinstance(job, Connect):
                self._connect = job
            self._busy = True
            self._send(job)

    def _device(self, progress: SessionProgress) -> Device:
        """That of the coming trial."""
        assert progress.coming is not None
        return progress.session.protocol.device(progress.coming.configuration)

    def hear(self, runner: "TrialRunner", write: Callable[..., None], say: Callable[..., None]) -> None:
        """What the loop says. write: into the journal; say: to the experimenter."""
        if runner.replaced:  # the new loop knows of no device
            runner.replaced, self._busy, self.linked = False, False, None
            self._send(self._connect)
        told, runner.told = runner.told, []
        for answer in told:
            match answer:
                case Linked():
                    self.linked = answer
                case Looked():
                    self._busy = False
                case Homed(tip):
                    self._busy = False
                    write(HOMED, tip_m=tip, board=self.linked.board if self.linked else "")
                case Zeroed(record):
                    self._busy = False
                    write(ZEROED, **record._asdict())
                case NotDone(why):
                    self._busy = False
                    say(f"{why[0].upper()}{why[1:]}.", bad=True)

    def checks(self, why_off: str) -> tuple[m.Check, m.Check]:
        """For the pre-flight row: device and hand."""
        return check_linked(self.linked, why_off), check_sensor(self.linked)

    def allow(self, presses: int) -> None:
        """Currents may flow again, if nobody has pressed since those presses of the brakes-off.

        The board has latched it, too, and what it latches is a brakes-off.
        """
        self._send(Reset(presses))

    def tip(self, progress: SessionProgress | None, practice: Simulation | None) -> m.Point:
        """Where the handle is, m; rounded, so that a hand that rests tells the window nothing new. Nobody knows it
        before the encoders are homed: then where the jig will hold it.
        """
        x, y = self.linked.tip if self.linked and self.linked.homed else self._home
        return round(x, 3), round(y, 3)

    def begin(self, session: Session, planned: PlannedTrial) -> tuple[LinkedTrial, RecordingWriter]:
        """Open a trial of the session on the board that is connected. InputError: a step is being done."""
        self._need_rest()
        assert self.linked is not None
        trial, writer = session.begin(planned, Sensors(self.linked.encoders, self.linked.force_channels))
        return trial, writer

    def ready_device(self, protocol: Protocol) -> Device | None:
        """The device on the bench, to practise on without a session. InputError: it is not ready, or a step is done."""
        self._need_rest()
        device = next((one for one in protocol.devices if self.linked and one.name == self.linked.device), None)
        if device is None or self.step(device) != DONE:
            raise InputError(
                "The device on the bench is not ready. Open a session: it leads through homing and zero; "
                "from then on practice needs none."
            )
        return device

    def _need_rest(self) -> None:
        if self._busy:
            raise InputError("A step on the device is being done: a moment.")

    def take_handle(self, simulation: Simulation) -> None:
        """A person has it already."""

    def close(self) -> None:
        """The loop lets the board go."""


def same(one: Device, other: Device) -> bool:
    """Whether two devices are so by the same files."""
    return (one.text, one.brake_texts, one.calibration_text) == (other.text, other.brake_texts, other.calibration_text)
