"""The simulated device as the state has it: always there, moved by mouse, six-axis device or simulated operator."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from app.ipc import messages as m
from app.ipc.messages import HID
from app.ipc.ring import Ring
from app.session_server.hid_input import HidInput, feel_force_alone
from app.session_server.preflight import check_device, check_hand
from app.session_server.session_progress import SessionProgress
from core.device import Device
from core.simulator.simulation import Simulation
from experiments.plan import PlannedTrial
from experiments.protocol import Protocol
from experiments.recording.writer import RecordingWriter
from experiments.session.journal import RERIGGED
from experiments.session.session import Session
from experiments.trial.trial import Trial
from hardware.hid import HidHand

if TYPE_CHECKING:
    from app.session_server.trial_runner import TrialRunner


class SimulatedDevice:
    """The counterpart of `rigging.DeviceSetup`."""

    real, linked = False, None

    def __init__(self, ring: Ring, hand: str) -> None:
        """InputError: the hand is a six-axis device, and none is attached."""
        self.hand, self._ring = hand, ring
        self._hid = HidInput(ring, HidHand()) if hand == HID else None

    def stage(self, progress: SessionProgress) -> str:
        """What the session waits for."""
        return progress.stage

    def wait_for(self, progress: SessionProgress) -> str:
        """What the person is to do, in one sentence."""
        return progress.wait_for()

    def confirm(self, progress: SessionProgress, write: Callable[..., None]) -> None:
        """The next configuration stands on the bench."""
        assert progress.coming is not None
        write(RERIGGED, configuration=progress.coming.configuration)
        progress.rigged = progress.coming.configuration

    def hear(self, runner: "TrialRunner", write: Callable[..., None], say: Callable[..., None]) -> None:
        """A simulated device says nothing by itself."""

    def allow(self, presses: int) -> None:
        """Currents may flow again, if nobody has pressed since those presses of the brakes-off."""
        if self._ring.presses == presses:
            self._ring.allow()

    def checks(self, why_off: str) -> tuple[m.Check, m.Check]:
        """For the pre-flight row: device and hand."""
        return check_device(True, why_off), self._hid.check if self._hid else check_hand(self.hand)

    def tip(self, progress: SessionProgress | None, practice: Simulation | None) -> m.Point:
        """Where the handle is, m. practice: the device of trials without a session."""
        if progress is not None:
            return progress.tip
        if practice is None:
            return 0.0, 0.0
        x, y = practice.state["tip"][0, :2]
        return float(x), float(y)

    def begin(self, session: Session, planned: PlannedTrial) -> tuple[Trial, RecordingWriter]:
        """Open a trial of the session."""
        self.take_handle(session.simulation(planned.configuration))
        return session.begin(planned)

    def ready_device(self, protocol: Protocol) -> Device | None:
        """The device on the bench, to practise on without a session: there is none."""
        return None

    def take_handle(self, simulation: Simulation) -> None:
        """Before a trial: the hand is ready."""
        if self._hid is not None:
            feel_force_alone(simulation)

    def close(self) -> None:
        """Let go."""
        if self._hid is not None:
            self._hid.close()
