"""The device of the session server, what has to be done before a configuration's trials, and the hand that moves it.

`SimulatedSetup` and `RealSetup` offer the same. A simulated device is always ready; the mouse, a six-axis device or a
simulated operator moves it. A real one is made ready step by step, connected, homed, zeroed, by the loop, which
reports how it is; a person's hand moves it.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from app.ipc import jobs
from app.ipc import messages as m
from app.ipc.messages import CONNECT, DONE, HOME, WAITS, ZERO, Check, DeviceStatus, Setup, StepCard
from app.ipc.ring import Ring
from app.session_server.preflight import check_device, check_hand, check_real, check_sensor
from app.session_server.session_progress import SessionProgress
from core.device import Device
from core.files import InputError
from core.simulator.simulated_device import SimulatedDevice
from experiments.inputs import HID, OPERATOR, SENSOR
from experiments.plan import PlannedTrial, participant_index
from experiments.protocol import Protocol, home_of
from experiments.recording import Sensors
from experiments.store.journal import HOMED, RERIGGED, ZEROED
from experiments.store.recording import RecordingWriter
from experiments.store.session import Session
from experiments.trial.operator import Person
from experiments.trial.population import load_population
from experiments.trial.trial import Trial
from hardware.hid import HidHand

Write = Callable[..., None]  # an event and its fields, into the journal

#: hand (of `INPUTS`) that moves the handle by its force -> the class that reads it, until it is closed
FORCE_HANDS = {HID: HidHand}


class SimulatedSetup:
    """A simulated device: the experimenter only confirms a re-rig."""

    real, status, doing = False, None, DONE

    def __init__(self, ring: Ring, hand: str, force_hands: Mapping[str, Callable[..., HidHand]] = FORCE_HANDS) -> None:
        """hand: what moves the device, of `INPUTS`. InputError: a six-axis device is chosen, and none is attached."""
        self.hand, self._ring = hand, ring
        self._force_hand = force_hands[hand](ring.push) if hand in force_hands else None  # until it is closed

    def card(self, progress: SessionProgress) -> StepCard | None:
        """The card of the step before the coming trial; None: no step."""
        coming = progress.coming
        if coming is None or coming.configuration == progress.rigged:
            return None
        device = progress.session.protocol.device(coming.configuration)
        following = f"Next: {device.name} (brakes at {' '.join(device.labels.values())}). "
        text = f"{following}The device is simulated: there is nothing to change by hand."
        return StepCard(f"Change to {device.name}", text, "It is done")

    def confirm(self, progress: SessionProgress, write: Write) -> None:
        """The experimenter has confirmed the step."""
        assert progress.coming is not None
        write(RERIGGED, configuration=progress.coming.configuration)
        progress.rigged = progress.coming.configuration

    def checks(self, why_off: str) -> tuple[Check, Check]:
        """Device and hand for the pre-flight row."""
        return check_device(True, why_off), check_hand(self.hand, self._force_hand.read() if self._force_hand else None)

    def allow(self, presses: int) -> None:
        """Allow currents again, unless the brakes-off was pressed more often than `presses`."""
        if self._ring.presses == presses:
            self._ring.allow()

    def tip(self, progress: SessionProgress | None, try_device: SimulatedDevice | None) -> m.Point:
        """Where the handle is in the coming configuration, m. try_device: the device of Try, once it is built."""
        if progress is None:
            return try_device.tip if try_device is not None else (0.0, 0.0)
        configuration = progress.coming.configuration if progress.coming else progress.rigged
        return progress.session.simulation(configuration or progress.session.protocol.devices[0].name).tip

    def begin(self, session: Session, planned: PlannedTrial) -> tuple[Trial, RecordingWriter]:
        """Open a trial of the session."""
        self.take_handle(session.simulation(planned.configuration))
        return session.begin(planned)

    def sandbox_device(self, protocol: Protocol, try_device: SimulatedDevice | None) -> SimulatedDevice:
        """The device of a pass of Try, ready for the hand."""
        assert try_device is not None, "the session server is still preparing"
        self.take_handle(try_device)
        return try_device

    def take_handle(self, device: SimulatedDevice) -> None:
        """Before a trial: where a measured force is the hand, switch the pointer's spring off."""
        if self._force_hand is not None:
            grip = device.hand.grips
            grip["spring"][0] = 1
            grip["stiffness"][0] = grip["damping"][0] = 0.0

    def close(self) -> None:
        """Close the six-axis device, if there is one."""
        if self._force_hand is not None:
            self._force_hand.close()


class RealSetup:
    """The device on the bench, whose board the loop talks to."""

    real, hand = True, SENSOR

    def __init__(self, protocol: Protocol, send: Callable[[jobs.LoopJob], None]) -> None:
        """protocol: whose devices are looked for at first. send: a job to the loop."""
        self.status: DeviceStatus | None = None  # None: the loop has not reported yet
        self._send, self._protocol, self._connect = send, protocol, jobs.Connect(tuple(protocol.devices))
        self._homed: dict[str, Any] | None = None  # fields of HOMED, while that homing holds
        self._zero: dict[str, Any] | None = None  # and of ZEROED
        self.reconnect()

    def reconnect(self) -> None:
        """Connect a new loop to the device."""
        self.status, self.doing = None, CONNECT  # the step that was asked for and not answered yet
        self._send(self._connect)

    def step(self, device: Device) -> str:
        """The next step before this device can be used; none for a lost board, which reconnects by itself.

        The loop must have the device as the session has it: the file may have changed.
        """
        status = self.status or DeviceStatus()
        if status.device != device.name or not any(same_files(device, other) for other in self._connect.devices):
            return CONNECT
        if status.problem or status.fault:
            return DONE
        if not status.homed:
            return HOME
        return DONE if status.zeroed else ZERO

    def card(self, progress: SessionProgress) -> StepCard | None:
        """The card of the step before the coming trial; None: no step."""
        if progress.coming is None or not (step := self.step(device := self._device(progress))):
            return None
        title = f"Make {device.name} ready"
        if self.doing:
            return StepCard(title, WAITS[self.doing], "")
        x, y = home_of(device, progress.session.protocol.paths)
        text = {
            CONNECT: f"Put {device.name} on the bench (brakes at {' '.join(device.labels.values())}), connect its "
            "board, then go on.",
            HOME: f"Hold the handle in its jig at x = {1e3 * x:.0f} mm, y = {1e3 * y:.0f} mm, then go on.",
            ZERO: "Let go of the handle, go on, and do not touch it for a second.",
        }
        return StepCard(title, text[step], device_page=True)

    def confirm(self, progress: SessionProgress, write: Write) -> None:
        """The experimenter has confirmed the step: the loop does its part."""
        self.do(progress, self.step(self._device(progress)))

    def do(self, progress: SessionProgress | None, step: str, sure: bool = False) -> None:
        """Let the loop do a step, again if need be; nothing while one is being done. progress: None: no session.

        InputError: the encoders are homed, have the handle elsewhere than in its jig, and nobody is `sure`.
        """
        if not step or self.doing:
            return
        jig = self._jig(progress)
        if step == HOME and not sure and (wrong := (self.status or DeviceStatus()).wrong_jig(jig)):
            raise InputError(f"Not homed. {wrong} Put it into the right jig, and home the encoders again.")
        if step == CONNECT and progress is not None:
            self._connect = jobs.Connect((self._device(progress),))
        self.doing = step
        wanted: dict[str, jobs.LoopJob] = {CONNECT: self._connect, HOME: jobs.HomeAt(jig), ZERO: jobs.TakeZero()}
        self._send(wanted[step])

    def _device(self, progress: SessionProgress) -> Device:
        """The device of the coming trial."""
        assert progress.coming is not None
        return progress.session.protocol.device(progress.coming.configuration)

    def _jig(self, progress: SessionProgress | None) -> m.Point:
        """Where the handle is held for homing, m: for the coming trial; before a session, of the connected device."""
        if progress is not None and progress.coming is not None:
            return home_of(self._device(progress), progress.session.protocol.paths)
        devices, connected = self._protocol.devices, self.status.device if self.status else ""
        return home_of(next((d for d in devices if d.name == connected), devices[0]), self._protocol.paths)

    def write_ready(self, write: Write) -> None:
        """Into the journal of a session that was opened: the homing and the zero that still hold."""
        for event, about in ((HOMED, self._homed), (ZEROED, self._zero)):
            if about is not None:
                write(event, **about)

    def take_answers(self, answers: Sequence[jobs.LoopAnswer], write: Write, notify: Callable[..., None]) -> None:
        """Handle the loop's answers about the device. write: into the journal; notify: shows the experimenter a
        sentence.
        """
        for answer in answers:
            if not isinstance(answer, DeviceStatus):
                self.doing = DONE
            match answer:
                case DeviceStatus():
                    self.status = answer
                    self._homed = self._homed if answer.homed else None
                    self._zero = self._zero if answer.zeroed else None
                case jobs.HomeSet(tip):
                    self._homed = {"tip_m": tip, "board": self.status.board if self.status else ""}
                    write(HOMED, **self._homed)
                    notify("")  # why it was refused before is true no more
                case jobs.Zeroed(record):
                    self._zero = record._asdict()
                    write(ZEROED, **self._zero)
                    notify("")
                case jobs.NotDone(why):
                    notify(f"{why[0].upper()}{why[1:]}.", bad=True)

    def checks(self, why_off: str) -> tuple[Check, ...]:
        """Device and, once it is reached, hand for the pre-flight row."""
        device = check_real(self.status, why_off, self.doing == CONNECT)
        return (device,) if self.status is None or self.status.problem else (device, check_sensor(self.status))

    def allow(self, presses: int) -> None:
        """Let the loop allow currents again, unless the brakes-off was pressed more often than `presses`.

        The board has latched the brakes-off, too, and a fault that the board latches is a brakes-off.
        """
        self._send(jobs.Reset(presses))

    def tip(self, progress: SessionProgress | None, try_device: SimulatedDevice | None) -> m.Point:
        """Where the handle is, m, rounded so that a resting hand changes no snapshot; before homing the jig's place."""
        x, y = self.status.tip if self.status and self.status.homed else self._jig(progress)
        return round(x, 3), round(y, 3)

    def begin(self, session: Session, planned: PlannedTrial) -> tuple[Trial, RecordingWriter]:
        """Open a trial of the session. InputError: the device is busy with a step."""
        self._refuse_while_busy()
        assert self.status is not None
        return session.begin(planned, Sensors(self.status.encoders, self.status.force_channels))

    def sandbox_device(self, protocol: Protocol, try_device: SimulatedDevice | None) -> Device:
        """The device of a pass of Try. InputError: it is not ready, or busy with a step."""
        self._refuse_while_busy()
        device = next(
            (device for device in protocol.devices if self.status and device.name == self.status.device), None
        )
        if device is None or self.step(device) != DONE:
            raise InputError("The device on the bench is not ready. The Device page (F3) says what comes next.")
        return device

    def _refuse_while_busy(self) -> None:
        if self.doing:
            raise InputError("The device is busy with a step. Try again in a moment.")

    def close(self) -> None:
        """Nothing to do: the loop releases the board."""


def same_files(a: Device, b: Device) -> bool:
    """Whether the files of two devices have the same content."""
    return (a.text, a.brake_texts, a.calibration_text) == (b.text, b.brake_texts, b.calibration_text)


def person_at(setup: Setup, protocol: Protocol, participant: str) -> Person | None:
    """The simulated operator with this participant's number; None: a person moves the handle."""
    if setup.hand != OPERATOR:
        return None
    seeds = np.random.SeedSequence([protocol.seed, participant_index(participant)])
    return load_population().draw(np.random.default_rng(seeds))
