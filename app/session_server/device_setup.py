"""The device of the session server, made ready before a configuration's trials, and the hand that moves it.

A simulated device is always ready; the mouse, a six-axis device or a simulated operator moves it. A real one is made
ready step by step, connected, homed, zeroed, by the loop, which tells how it is; a person's hand moves it.
"""

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

from app.ipc import messages as m
from app.ipc.messages import (
    BAD,
    CONNECT,
    DONE,
    GOOD,
    HID,
    HOME,
    ZERO,
    Check,
    Connect,
    DeviceStatus,
    HomeAt,
    Homed,
    Looked,
    NotDone,
    Reset,
    TakeZero,
    Zeroed,
)
from app.ipc.ring import Ring
from app.session_server.preflight import check_device, check_hand, check_real, check_sensor
from app.session_server.session_progress import SessionProgress
from core.device import Device
from core.files import InputError
from core.simulator.simulated_device import SimulatedDevice
from experiments.plan import PlannedTrial
from experiments.protocol import Protocol, home_of
from experiments.recording.schema import Sensors
from experiments.recording.writer import RecordingWriter
from experiments.session.journal import HOMED, RERIGGED, ZEROED
from experiments.session.session import Session
from experiments.trial.inputs import SENSOR
from experiments.trial.trial import Trial
from hardware.hid import HidHand

if TYPE_CHECKING:
    from app.session_server.trial_runner import TrialRunner

HID_S = 0.004  # between two looks at a six-axis device: twice as often as one reports


class DeviceSetup:
    """What the device is, and what has to be done to it next."""

    def __init__(
        self, protocol: Protocol, ring: Ring, send: Callable[[object], None], hand: str, real: bool,
        hid: Callable[[], HidHand] = HidHand,
    ) -> None:  # fmt: skip
        """protocol: whose devices are looked for at first. send: a job to the loop. hand: of a simulated device.

        InputError: the hand is a six-axis device, and none is attached.
        """
        self.real, self.hand = real, SENSOR if real else hand
        self.status: DeviceStatus | None = None  # of a real device; None: not told yet
        self._ring, self._send, self._connect = ring, send, Connect(tuple(protocol.devices))
        self._home = home_of(protocol.devices[0], protocol.paths)
        self._busy = False  # a step has been asked for and not been answered
        self._hid = HidInput(ring, hid()) if self.hand == HID else None
        if real:
            send(self._connect)

    def stage(self, progress: SessionProgress) -> str:
        """As the session's; but a real device has to be made ready, and again after its board has lost its power."""
        stage = progress.stage
        if not self.real or stage not in (m.READY, m.RERIG) or progress.coming is None:
            return stage
        if self.step(self._device(progress)):
            return m.RERIG
        progress.rigged = progress.coming.configuration
        return progress.stage

    def step(self, device: Device) -> str:
        """What is next before this real device can be used. A board that is lost is no step: it comes back itself.

        The loop must have the device as the session has it: the file may be another one by now.
        """
        status = self.status or DeviceStatus()
        if status.device != device.name or not any(same(device, one) for one in self._connect.devices):
            return CONNECT
        if status.problem or status.fault:
            return DONE
        if not status.homed:
            return HOME
        return DONE if status.zeroed else ZERO

    def wait_for(self, progress: SessionProgress) -> str:
        """What the person is to do, in one sentence."""
        if not self.real or self.stage(progress) != m.RERIG or progress.coming is None:
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
        """The person has done it. write: into the journal. With a real device the loop now does its part."""
        if self.real:
            self.do(progress, self.step(self._device(progress)))
            return
        assert progress.coming is not None
        write(RERIGGED, configuration=progress.coming.configuration)
        progress.rigged = progress.coming.configuration

    def do(self, progress: SessionProgress, step: str) -> None:
        """Let the loop do a step on the real device, or do it again; while one is being done, nothing."""
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
        """What the loop says of a real device. write: into the journal; say: to the experimenter."""
        if runner.replaced and self.real:  # the new loop knows of no device
            runner.replaced, self._busy, self.status = False, False, None
            self._send(self._connect)
        told, runner.told = runner.told, []
        for answer in told:
            match answer:
                case DeviceStatus():
                    self.status = answer
                case Looked():
                    self._busy = False
                case Homed(tip):
                    self._busy = False
                    write(HOMED, tip_m=tip, board=self.status.board if self.status else "")
                case Zeroed(record):
                    self._busy = False
                    write(ZEROED, **record._asdict())
                case NotDone(why):
                    self._busy = False
                    say(f"{why[0].upper()}{why[1:]}.", bad=True)

    def checks(self, why_off: str) -> tuple[Check, Check]:
        """For the pre-flight row: device and hand."""
        if self.real:
            return check_real(self.status, why_off), check_sensor(self.status)
        return check_device(True, why_off), self._hid.check if self._hid else check_hand(self.hand)

    def allow(self, presses: int) -> None:
        """Currents may flow again, if the brakes-off was not pressed again after those presses.

        A board has latched it, too, and what it latches is a brakes-off: there the loop does it.
        """
        if self.real:
            self._send(Reset(presses))
        elif self._ring.presses == presses:
            self._ring.allow()

    def tip(self, progress: SessionProgress | None, practice: SimulatedDevice | None) -> m.Point:
        """Where the handle is, m. practice: the device of trials without a session.

        Of a real device rounded, so that a hand that rests tells the window nothing new; before its encoders are homed,
        where the jig will hold it.
        """
        if self.real:
            x, y = self.status.tip if self.status and self.status.homed else self._home
            return round(x, 3), round(y, 3)
        if progress is not None:
            return progress.tip
        return practice.tip if practice is not None else (0.0, 0.0)

    def begin(self, session: Session, planned: PlannedTrial) -> tuple[Trial, RecordingWriter]:
        """Open a trial of the session. InputError: a step is being done on the real device."""
        if self.real:
            self._need_rest()
            assert self.status is not None
            return session.begin(planned, Sensors(self.status.encoders, self.status.force_channels))
        self.take_handle(session.simulation(planned.configuration))
        return session.begin(planned)

    def ready_device(self, protocol: Protocol) -> Device | None:
        """The real device, to practise on without a session; None: it is simulated.

        InputError: it is not ready, or a step is being done.
        """
        if not self.real:
            return None
        self._need_rest()
        device = next((one for one in protocol.devices if self.status and one.name == self.status.device), None)
        if device is None or self.step(device) != DONE:
            raise InputError(
                "The device on the bench is not ready. Open a session: it leads through homing and zero; "
                "from then on practice needs none."
            )
        return device

    def _need_rest(self) -> None:
        if self._busy:
            raise InputError("A step on the device is being done: a moment.")

    def take_handle(self, device: SimulatedDevice) -> None:
        """Before a trial on a simulated device: a six-axis device's force alone moves it, no spring."""
        if self._hid is not None:
            feel_force_alone(device)

    def close(self) -> None:
        """Let the hand's device go; the loop lets the board go."""
        if self._hid is not None:
            self._hid.close()


class HidInput:
    """Brings the newest force of a six-axis device to the control loop, until `close`; it is no force sensor."""

    def __init__(self, ring: Ring, hand: HidHand) -> None:
        """hand: an attached device, which is this object's from now on."""
        self._ring, self._hand, self._ended = ring, hand, threading.Event()
        self._thread = threading.Thread(target=self._work, name="hand force", daemon=True)
        self._thread.start()

    def _work(self) -> None:
        while not self._ended.wait(HID_S):
            reading = self._hand.read()
            self._ring.push(reading.fx_N, reading.fy_N)

    @property
    def check(self) -> Check:
        """For the pre-flight row: which device, and that it is no force sensor."""
        reading = self._hand.read()
        if reading.connected:
            return Check("Hand", GOOD, reading.text)
        return Check("Hand", BAD, "unplugged", f"{reading.text[0].upper()}{reading.text[1:]}.")

    def close(self) -> None:
        """No force from now on."""
        self._ended.set()
        self._thread.join()
        self._ring.push(0.0, 0.0)
        self._hand.close()


def feel_force_alone(device: SimulatedDevice) -> None:
    """No spring between pointer and handle: the hand is the force that is pushed."""
    grip = device.hand.grips
    grip["spring"][0] = 1
    grip["stiffness"][0] = grip["damping"][0] = 0.0


def same(one: Device, other: Device) -> bool:
    """Whether two devices are so by the same files."""
    return (one.text, one.brake_texts, one.calibration_text) == (other.text, other.brake_texts, other.calibration_text)
