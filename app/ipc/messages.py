"""The messages between a window and its session server.

The window sends commands; the session server sends its state. The window holds no state of the experiment: `Opened` and
the newest `Snapshot` are all of it.
"""

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, Self

from experiments.inputs import MOUSE

if TYPE_CHECKING:  # else each process imports all of this before it can start the next
    from experiments.analysis.metrics import Metrics
    from experiments.analysis.trials_table import TrialRow
    from experiments.plan import PlannedTrial
    from experiments.protocol import Protocol

Point = tuple[float, float]  # m

MAX_HOMING_M = 0.002  # from the pose that is known to that of the jig, without a question. Our choice

# ------------------------------------------------------------------------------- from the window to its session server


class Setup(NamedTuple):
    """Choices of the command line; None: as the protocol says."""

    data_dir: Path
    protocol: str = "paper"  # a shipped one by name, or a file
    devices: tuple[str, ...] | None = None
    rules: str | None = None
    low_gain: float | None = None  # N s/m
    seed: int | None = None
    hand: str = MOUSE  # of `experiments.inputs.INPUTS`
    participant: str = ""  # to be offered first; "": the first without a session
    link: str = ""  # serial port of a device on the bench, or "PORT netft:HOST"; "": simulated
    real_time: bool = True  # try scheduling that needs a privilege
    sync: bool = True  # wait for the disk itself
    lsl: bool = False  # stream ticks and markers by the Lab Streaming Layer

    def to_json(self) -> str:
        return json.dumps({**self._asdict(), "data_dir": str(self.data_dir)})

    @classmethod
    def from_json(cls, text: str) -> Self:
        fields = json.loads(text)
        devices = fields["devices"]
        return cls(**{**fields, "data_dir": Path(fields["data_dir"]), "devices": devices and tuple(devices)})


# ----------------------------------------------------------------------------------- commands: window -> session server


class Open(NamedTuple):
    """Open a session: a new one, or (resume) one that was begun."""

    participant: str
    resume: bool = False
    blind: bool = False  # the experimenter too
    form: dict[str, str | float] = {}  # noqa: RUF012  (never changed) what the protocol asks of a new participant
    consent: tuple[bool, str] | None = None  # whether they take part, and when they said so (ISO, UTC); None: not asked


class Start(NamedTuple):
    """Run the next trial of the plan, or the next pass of Try on a real device."""


class Abort(NamedTuple):
    """End the running trial at once, brakes off, for this reason; its recording is kept."""

    reason: str
    again: str = "never"  # when the trial is repeated: "now" (next), at the "end" of its configuration, "never"


class Redo(NamedTuple):
    """Repeat the cell of this run next; the original is kept and marked."""

    run: int
    reason: str


class Exclude(NamedTuple):
    """Take this run out of every result but the table, for this reason; its recording is kept."""

    run: int
    reason: str


class Skip(NamedTuple):
    """Do not run the coming trial, for this reason."""

    reason: str


class Pause(NamedTuple):
    """No further trial starts after the running one, until resumed; the pause is journalled with its length."""

    on: bool


class Note(NamedTuple):
    """Write this text into the journal."""

    text: str


class AllowBrakes(NamedTuple):
    """Allow currents again after a brakes-off."""


class Confirm(NamedTuple):
    """The step before the next trial (the re-rig, the break) is done."""


class PrepareDevice(NamedTuple):
    """Do a step that makes the device on the bench ready, between two trials or before a session."""

    step: str  # CONNECT, HOME, ZERO
    sure: bool = False  # home, although the encoders have the handle elsewhere


class Unblind(NamedTuple):
    """Open the key of a blind session; the journal says who asked for it."""

    who: str


class Leave(NamedTuple):
    """Close the session, finished or not."""


class Answers(NamedTuple):
    """The participant's answers after a block: item -> value."""

    values: dict[str, float]


class SandboxSettings(NamedTuple):
    """The settings of Try."""

    device: str
    path: int  # its number in the protocol
    controller: int  # its number in the protocol
    values: dict[str, float]  # of each parameter that a controller of the protocol has, SI units
    rules: str
    blend_width_m: float
    spring_N_m: float  # between pointer and handle
    brake_strength: float  # share of K(I), Eq. (2)
    backlash_deg: float
    sensing: str  # what the controller sees of a simulated device: IDEAL, or ENCODERS with their filter and delay

    def with_parameters(self, **others: float) -> "SandboxSettings":
        """These settings with other values of some parameters."""
        return self._replace(values={**self.values, **others})


class SetSandbox(NamedTuple):
    """Open Try with these settings, or change them, which acts at once, also during a pass."""

    settings: SandboxSettings | None = None  # None: as protocol and device have them


class BringBack(NamedTuple):
    """Bring the handle to the start and give the running pass of Try up."""


class EndSandbox(NamedTuple):
    """Leave Try; the running pass ends and is not measured."""


class Quit(NamedTuple):
    """End the session server; the running trial is aborted and kept."""

    reason: str


# -------------------------------------------------------------------------------------- state: session server -> window

#: stages of the session server
PREPARING, NO_SESSION, READY, RUNNING, RERIG, BREAK, QUESTIONS, FINISHED, FAILED = (
    "preparing", "no session", "ready", "running", "re-rig", "break", "questions", "finished", "failed"
)  # fmt: skip

#: stage -> why a command that does not fit it is refused; for other steps between two trials the card says why
NOT_NOW = {
    PREPARING: "Everything is still being prepared.",
    NO_SESSION: "No session is open.",
    READY: "A session is open.",
    RUNNING: "A trial is running.",
    RERIG: "The device must be re-rigged first.",
    BREAK: "There is a break first.",
    QUESTIONS: "The questions after the block come first.",
    FINISHED: "All trials of the plan are done.",
    FAILED: "No more trials can be run.",
}

#: steps that make a device on the bench ready; DONE: there is none to do
CONNECT, HOME, ZERO, DONE = "connect", "home", "zero", ""
#: step -> what is shown while it is being done, on the button that asked for it
WAITS = {CONNECT: "Connecting …", HOME: "Homing …", ZERO: "Zeroing …"}

DISK_WAIT = "Waiting for the disk"  # beginning of the notice while a command waits for it
FORCE_SENSOR = "Force sensor"  # name of the check of what measures the hand, where it does
BRAKES_OFF = "brakes off"  # text of the check "Device" while a device is connected and no current may flow
#: states of a check; DUE: a later step of the session will put it right
GOOD, CAUTION, DUE, BAD, WAITING = "good", "caution", "due", "bad", "waiting"


class Check(NamedTuple):
    """One pre-flight check. No trial starts while any is DUE, BAD or WAITING."""

    name: str  # "Device", "Hand" or FORCE_SENSOR, "Loop", "Disk", "Recording"
    state: str  # GOOD, CAUTION, DUE, BAD, WAITING
    text: str  # short: "simulated", "mouse", "1 kHz, p99 31 µs", "82 GB free", "on"
    advice: str = ""  # what to do about it, one sentence


class StepCard(NamedTuple):
    """The card of a step that comes before the next trial."""

    title: str
    text: str  # what is to be done, one sentence
    go_on: str = "Go on"  # the button that sends Confirm; "": it is being done, or the participant does it
    device_page: bool = False  # the device page helps
    wait_s: float = 0.0  # whole seconds that the step lasts at least from now on
    participant: str = ""  # what the participant reads meanwhile; "": the sentence of the stage


class CannotServe(NamedTuple):
    """The session server cannot start, and has written nothing."""

    why: str  # one sentence
    folder: bool = False  # another data folder would help


class Opened(NamedTuple):
    """What does not change while a session is open; sent when a window connects and when a session is opened."""

    participant: str  # "" before a session
    protocol: "Protocol"
    plan: "tuple[PlannedTrial, ...]"
    plan_sha256: str
    folder: str
    real_device: bool  # currents flow in real brakes
    hand: str  # what moves the handle, of `INPUTS`
    blind: bool = False  # every new session is blind


class Pass(NamedTuple):
    """A pass of Try that has ended."""

    number: int  # 1 ..
    settings: SandboxSettings  # at its end
    initial: SandboxSettings  # as protocol and device have them, for its device and path
    changed: bool  # on the way
    status: str  # "done", "timeout"
    measures: "Metrics"


class SandboxState(NamedTuple):
    """The state of Try."""

    settings: SandboxSettings
    initial: SandboxSettings  # as protocol and device have them
    fixed: tuple[str, ...]  # settings that cannot be changed: of a real device, of a hand without a spring
    by_start: bool  # real brakes: a pass waits for Start, and a change for the next pass
    least_gain_N_s_m: float  # a controller of less gain does less than the brakes' own drag
    passes: tuple[Pass, ...] = ()  # the newest last


class Snapshot(NamedTuple):
    """The state of the session; sent whenever it changes."""

    stage: str  # PREPARING ..
    rows: "tuple[TrialRow, ...]" = ()  # of this session, redone ones included
    coming: "PlannedTrial | None" = None
    running: "PlannedTrial | None" = None
    practice: bool = False  # the running or coming trial is practice
    tip: Point = (0.0, 0.0)  # m, where the handle stands in the coming configuration
    paused: bool = False  # now, or after the running trial
    blind: bool = False  # hide currents, decisions, brake colours, controller names
    checks: tuple[Check, ...] = ()
    brakes_off: str = ""  # its cause; "": brakes may act
    notes: tuple[str, ...] = ()  # "13:02 asked to move a little slower"
    notice: str = ""  # to the experimenter: what just happened or what was refused
    notice_bad: bool = False
    card: StepCard | None = None  # what is to be done before the next trial
    step: str = DONE  # that the device on the bench is doing: CONNECT, HOME, ZERO
    sandbox: SandboxState | None = None  # None: Try is not open
    seconds_left: float | None = None  # of the whole session, estimated; None: none is open
    newest: "TrialRow | None" = None  # of the trials that ended since the session was opened, practice included
    not_written: str = ""  # why not all of the session is on the disk, and what to do; "": all is
    in_memory: str = ""  # data that are not on the disk: "trial 5, 5,481 ticks"; "": none

    @property
    def stage_refusal(self) -> str:
        """Why a command that does not fit the stage is refused."""
        if self.card is None or self.stage in NOT_NOW:
            return NOT_NOW[self.stage]
        return f"{self.card.title}: this comes first."

    @property
    def trial_blocker(self) -> str:
        """Why no trial can start; "": one can. The server refuses by it, the window greys its buttons."""
        if self.stage not in (READY, NO_SESSION):
            return self.stage_refusal
        if self.paused:
            return "The session is paused: resume it first (Alt+P)."
        if self.brakes_off:
            return f"Brakes are off: {self.brakes_off}"
        for state in (BAD, DUE, WAITING):
            for check in self.checks:
                if check.state == state:
                    return f"{check.name}: {check.text}" + (f". {check.advice}" if check.advice else "")
        return ""

    @property
    def can_leave(self) -> bool:
        """Whether the session can be closed: it is open, and no trial is running."""
        return self.stage not in (PREPARING, NO_SESSION, RUNNING, FAILED)

    @property
    def _device(self) -> Check:
        """The check of the device; before there is one, of a device that is well."""
        return next((check for check in self.checks if check.name == "Device"), Check("Device", GOOD, ""))

    @property
    def can_turn_off(self) -> bool:
        """Whether there are brakes to be turned off: they are on, and a session or Try is open."""
        return not self.brakes_off and (self.sandbox is not None or self.stage not in (PREPARING, NO_SESSION))

    @property
    def can_allow(self) -> bool:
        """Whether the brakes are off and can be allowed again: where no device is reached, it comes first."""
        return bool(self.brakes_off) and (self._device.state not in (BAD, WAITING) or self._device.text == BRAKES_OFF)

    @property
    def place_known(self) -> bool:
        """Whether the handle's position is measured: the device is connected and homed."""
        return self._device.state not in (DUE, BAD, WAITING) or self._device.text == BRAKES_OFF

    def session_blocker(self, real_device: bool) -> str:
        """Why no session can be opened; "": one can. On the bench a session comes before homing and zeroing."""
        if not real_device:
            return self.trial_blocker
        others = tuple(check for check in self.checks if check.name not in ("Device", "Hand", FORCE_SENSOR))
        return self._replace(checks=others, brakes_off="").trial_blocker


class Proof(NamedTuple):
    """The part of the running recording that is on the disk."""

    name: str
    rows: int
    bytes: int
    age_s: float  # since the last write

    @property
    def late(self) -> bool:
        """Whether the last write was so long ago that it is worth a look."""
        return self.age_s >= 1.0


class DeviceStatus(NamedTuple):
    """The state of a real device, about ten times a second while no trial runs."""

    device: str = ""  # the one that its board is wired to; "": none has been reached
    board: str = ""  # its number
    problem: str = ""  # why there are no samples
    fault: str = ""  # latched on the board
    homed: bool = False
    zeroed: bool = False
    tip: tuple[float, float] = (0.0, 0.0)  # m
    hand_force: tuple[float, float] = (0.0, 0.0)  # N
    encoders: str = ""
    force_channels: int = 0
    report: dict = {}  # health counters and clock
    port: str = ""
    counts: tuple[int, ...] = ()  # of the encoders, in the order of their letters
    theta: tuple[float, ...] = ()  # rad, joints A, E, B, C
    homed_at: float = 0.0  # s since 1970, when it was last homed by this loop; 0: never
    zeroed_at: float = 0.0
    reported_s: float = 0.0  # monotonic clock

    def wrong_jig(self, jig: Point) -> str:
        """Why homing with the handle held at `jig` (m) is to be asked about, a sentence; "": it is not.

        Encoders that are homed already must have the handle there, or the jig is a wrong one, or it does not hold it.
        """
        off_m = math.dist(self.tip, jig)
        if not self.homed or off_m <= MAX_HOMING_M:
            return ""
        return f"By the encoders, which are homed already, the handle is {1e3 * off_m:.1f} mm from its jig."


class Pulse(NamedTuple):
    """About ten times a second, and before every change of the state: proof of recording."""

    proof: Proof | None  # None: nothing is being recorded
    verified: int  # earlier runs of this session whose recording was verified
    device: DeviceStatus | None = None  # a real one, while no trial runs; None: not reported yet
