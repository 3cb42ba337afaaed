"""The Haply 2diy as a device with two brakes (`core.device_interface.RealDevice`): `--link haply:PORT`.

The board answers each pair of torques with its encoders: an exchange is one question and one answer, and its torques
follow from the answer before. The board has neither clock nor watchdog: samples bear the time of this computer, and
`guarded_port` watches over the motors. Whatever is doubtful (no answer, an answer that is none, an exchange that came
late, a joint that is too fast, a motor that is too hot) is answered with no torque.

It has no force sensor. The hand's force is what the motion needs beyond motors and friction (a disturbance observer),

    F = M a + b - sum of g_i (torque_i - friction_i sgn omega_i)

with the mass matrix M and b of core/dynamics, the acceleration a of the motion filter, and the motors' torques averaged
over that filter's window: 7 ms old, wrong by what masses and friction of the device file are wrong, and by the noise of
a (docs/haply.md has its error on the simulated device, whose masses are right).
"""

import math
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from core.device import Device
from core.device_interface import DeviceError, DeviceSample, ZeroRecord
from core.faults import Cause, cause, cause_of
from core.files import InputError
from core.simulator.state import new_state, pack_mechanism
from core.simulator.stick_slip_mode import update_kinematics
from core.tick_log import TICK_S
from hardware.emulated_board.device import hello_of
from hardware.haply.guarded_port import GuardedPort
from hardware.haply.rendered_brake import RenderedBrake
from hardware.haply.wire import ANGLES, NO_TORQUE, RESET, counts_of, drive, set_up
from hardware.sensing.encoders import load_kernels
from hardware.sensing.samples import NO_ZERO, WINDOW, BoardSensing
from hardware.serial_port import Port, find_port
from hardware.wire.messages import Sample, State

MOTORS = (0, 2)  # joints A and B, in the order A, E, B, C
STIFFNESS = 3.5  # N m/rad, of a hold: 0.5 N pulls the handle 0.6 mm. Our choice: a stiffer one chatters at rest
SPEED_MAX = 10.0  # rad/s, 0.7 m/s at the end of a proximal link. Our choice
#: Assumed of the motors: torque constant; of a winding: resistance (ohm), heat resistance (K/W), time (s); room (degC)
NM_PER_A, OHM, K_PER_W, HEAT_S, ROOM_C = 0.06, 2.2, 12.0, 30.0, 25.0
HOT_C, COOL_C = 85.0, 60.0  # no torque from here on, until it is so cool again. Our choice
SETTLE_S = 0.05  # from the set-up of the board to the first question. Assumed
SLACK_S = 1e-5  # by which an exchange may be early
LATE_S = 0.01  # between exchanges; after longer no torque, for the watchdog may have spoken
SILENT_S = 0.05  # without an answer: the board is lost
READS, FIRST_READS = 2, 50  # of a port that waits 2 ms, for an answer, and for the first
AGAIN_S = 0.5  # between attempts to reach a lost board
MOST_BAD = 5  # answers on end that are none: the board is lost
MOST_KEPT = 2000  # samples that wait for `samples`


class HaplyDevice:
    """A 2diy at a port. What is given for two motors is in the order A, B."""

    def __init__(
        self, device: Device, port: str, clock: Callable[[], float] = time.perf_counter,
        open_port: Callable[[str], Port] = GuardedPort, sleep: Callable[[float], None] = time.sleep,
    ) -> None:  # fmt: skip
        """port: as `SerialDevice` takes it. clock, open_port, sleep: of the machine, but for tests. InputError: the
        device file is of no 2diy.
        """
        hello = hello_of(device, "HAPLY")
        if device.braked != "AB" or hello.encoders != 0b0101 or device.mechanism.coupled:
            raise InputError(f"device {device.name}: a Haply has motors and encoders at A and B alone, as haply-2diy")
        self.device, self.port, self.clock = device, port, clock
        self.encoders, self.force_channels, self.zeroed = "AB", 0, True
        self.problem = "not opened yet"
        self._hello, self._open_port, self._sleep = hello, open_port, sleep
        self._per_rev = hello.counts_per_rev[0], hello.counts_per_rev[2]
        self._files = [device.brake_files[joint] for joint in "AB"]
        self._friction = [file.torque_gain(0.0) for file in self._files]
        self._mechanism = pack_mechanism(device.mechanism).view(np.ndarray)
        self._motion = new_state(0.0, 0.0).view(np.ndarray)  # plain arrays: read from Python they take less time
        self._tip, self._rows, self._mass, self._bias = (
            self._motion[name][0] for name in ("tip", "g", "mass", "bias_force")
        )
        self._wire: Port | None = None
        self._began = self._heard = self._asked = self._tried = self._due = -math.inf
        self._sequence = self._answers = self._bad = self._bad_on_end = self._lost_links = 0
        self._taken: deque[DeviceSample] = deque(maxlen=MOST_KEPT)
        self.warmth = [ROOM_C, ROOM_C]  # degC, of the windings by their model
        self._fault = ""  # latched until `reset`
        self._counts = (0, 0)
        self._begin()

    def _begin(self) -> None:
        """Reset everything that does not outlive a connection: the board's counts begin at zero."""
        self._buffer = b""
        self._sent: deque[tuple[tuple[float, float], list[float]]] = deque()  # torques and currents, unanswered
        self._acted: deque[tuple[float, float]] = deque(maxlen=WINDOW)
        self._offset, self._homed = (0, 0), 0
        self._largest: float | None = None  # torque that may have acted while answers were lost; None: none was
        self.sensing = BoardSensing(self.device, self._hello)
        self.brakes = [
            RenderedBrake(self._holds(motor, file.current_max_A), STIFFNESS, SPEED_MAX, math.tau / per_rev)
            for motor, (file, per_rev) in enumerate(zip(self._files, self._per_rev, strict=True))
        ]

    def _holds(self, motor: int, current: float) -> float:
        """The torque that a motor holds for its brake at a current (A): beyond the joint's friction."""
        return self._files[motor].torque_gain(current) - self._friction[motor]

    def _limited(self, motor: int, current: float) -> float:
        """A current (A) within the brake's limit; 0 if not finite. The last line before the wire."""
        return min(current, self._files[motor].current_max_A) if 0.0 < current < math.inf else 0.0

    # ----------------------------------------------------------------------------------------- from first to last

    def open(self) -> None:
        """InputError: no Haply answers there."""
        load_kernels(self.device)
        update_kinematics(self._mechanism[0], self._motion[0])
        try:
            self._reach()
        except DeviceError as error:
            raise InputError(cause_of(error)) from None

    def _reach(self) -> None:
        wire = self._open_port(find_port(self.port))
        try:
            wire.write(RESET + set_up(self._per_rev))
            self._sleep(SETTLE_S)
            wire.read()  # answers to the watchdog, or to another program
            wire.write(NO_TORQUE)
            answer = next(filter(None, (wire.read() for _ in range(FIRST_READS))), b"")[-ANGLES.size :]
            if len(answer) < ANGLES.size or counts_of(answer, self._per_rev) is None:
                raise DeviceError(cause("no-board", name=wire.name))
        except BaseException:
            wire.close()
            raise
        self._begin()
        self._wire, self.problem = wire, ""
        self._heard = self._asked = self.clock()
        if not math.isfinite(self._began):
            self._began = self._heard

    def _lose(self, reason: str) -> None:
        wire, self._wire, self.problem = self._wire, None, reason
        self._lost_links += 1
        self._tried = self.clock()
        if wire is not None:
            wire.close()

    def close(self) -> None:
        """No torque, and leave."""
        if self._wire is not None:
            try:
                self._wire.write(NO_TORQUE + RESET)
            except DeviceError:  # gone already
                pass
            self._wire.close()
        self._wire, self.problem, self._tried = None, "closed", math.inf

    # ------------------------------------------------------------------------------------------------- every tick

    def exchange(self, currents: Sequence[float]) -> DeviceSample | None:
        """Currents (4,), A, of the brakes that the motors stand for; the newest sample. It keeps the pace of 1 kHz."""
        if (early := self._due - self.clock()) > SLACK_S:
            self._sleep(min(early, TICK_S))
        now = self.clock()
        self._due = max(self._due, now - TICK_S) + TICK_S
        try:
            if self._wire is None and now - self._tried >= AGAIN_S:
                self._tried = now
                self._reach()
            if self._wire is not None:
                return self._exchange(self._wire, currents, now)
        except (DeviceError, InputError) as error:
            self._lose(cause_of(error))
        self._sleep(TICK_S)
        return None

    def _exchange(self, wire: Port, currents: Sequence[float], now: float) -> DeviceSample | None:
        if now - self._asked > LATE_S:
            self._heard = now  # this host did not listen, and that is no silence
            self._forget_answers(wire)
        self._asked = now
        doubtful = self._sent or self._largest is not None or self._fault or self._hot()
        limited = [0.0 if doubtful else self._limited(n, currents[i]) for n, i in enumerate(MOTORS)]
        torques = tuple(brake.torque(self._holds(n, limited[n])) for n, brake in enumerate(self.brakes))
        self._sent.append(((torques[0], torques[1]), limited))
        wire.write(drive(*torques))
        return self._listen(wire, now)

    def _forget_answers(self, wire: Port) -> None:
        """Forget the answers on their way: some may be missing or not ours, so the torques that acted are unknown."""
        may_have_acted = [*self._acted, *(torques for torques, _ in self._sent)][-1 - len(self._sent) :]
        largest = max((abs(torque) for torques in may_have_acted for torque in torques), default=0.0)
        self._largest = max(self._largest or 0.0, largest)
        self._sent.clear()
        self._buffer = b""
        for _ in range(READS):
            wire.read()

    def _listen(self, wire: Port, now: float) -> DeviceSample | None:
        newest = None
        for _ in range(READS):
            self._buffer += wire.read()
            while len(self._buffer) >= ANGLES.size:
                answer, self._buffer = self._buffer[: ANGLES.size], self._buffer[ANGLES.size :]
                counts = counts_of(answer, self._per_rev)
                if counts is None or not self._sent:
                    self._bad, self._bad_on_end = self._bad + 1, self._bad_on_end + 1
                    if self._bad_on_end >= MOST_BAD:
                        raise DeviceError(cause("port", name=wire.name, what="what comes there is no Haply's"))
                    self._forget_answers(wire)
                    return None
                newest = self._answer(counts, now)
            if newest is not None:
                self._heard = now
                return newest
        if now - self._heard > SILENT_S:
            raise DeviceError(cause("no-sample", ms=1e3 * SILENT_S))
        return None

    def _answer(self, counts: tuple[int, int], now: float) -> DeviceSample:
        """The sample of an answer. The torques that it answers act from now on."""
        torques, currents = self._sent.popleft()
        self._bad_on_end = 0
        ticks = max((now - self._heard) / TICK_S, 1.0)
        angles = [math.tau * n / per_rev for n, per_rev in zip(counts, self._per_rev, strict=True)]
        before, self._counts = self._counts, counts
        for i, brake in enumerate(self.brakes):
            turned = math.tau * abs(counts[i] - before[i]) / self._per_rev[i]
            if self._largest is not None:
                brake.read_after_loss(angles[i], self._largest)
            else:
                brake.read(angles[i], torques[i])
                if self._answers and turned > ticks * brake.most_turned + math.tau / self._per_rev[i]:
                    self._fault = self._fault or cause("over-speed")
            self._heat_up(i, self._acted[-1][i] if self._acted else 0.0)
        self._largest = None
        self._answers += 1
        self._acted.append(torques)
        self._sequence = max(self._sequence + 1, round((now - self._began) / TICK_S))
        sample = self._sample(counts, currents, now)
        self._taken.append(sample)
        return sample

    def _sample(self, counts: tuple[int, int], currents: list[float], now: float) -> DeviceSample:
        read = Sample(
            self._sequence, self._sequence, round(1e6 * (now - self._began)), State.READY, self._homed, 0, 0,
            (counts[0] + self._offset[0], counts[1] + self._offset[1]), (),
            tuple(round(1e3 * current) for current in currents),
        )  # fmt: skip
        self.sensing.fault = self._fault
        sample = self.sensing.take(read, now)
        return sample._replace(hand_force=self._hand_force(sample)) if self._homed else sample

    def _hand_force(self, sample: DeviceSample) -> tuple[float, float]:
        """The disturbance observer, N."""
        if not all(map(math.isfinite, sample.tip)):
            return 0.0, 0.0
        self._tip[:2], self._tip[2:] = sample.tip, sample.velocity
        update_kinematics(self._mechanism[0], self._motion[0])
        (xx, xy, yy), (ax, ay) = self._mass.tolist(), sample.acceleration
        fx, fy = self._bias.tolist()
        fx, fy = fx + xx * ax + xy * ay, fy + xy * ax + yy * ay
        vx, vy = sample.velocity
        for n, (gx, gy) in enumerate(self._rows[:3:2].tolist()):
            rate = gx * vx + gy * vy
            torque = sum(torques[n] for torques in self._acted) / len(self._acted)
            torque -= math.copysign(self._friction[n], rate) if rate else 0.0
            fx, fy = fx - gx * torque, fy - gy * torque
        return fx, fy

    def _heat_up(self, motor: int, torque: float) -> None:
        """Update the temperature of a winding (first order, heated by its current) for a tick."""
        heat = OHM * (torque / NM_PER_A) ** 2 * K_PER_W
        self.warmth[motor] += (heat + ROOM_C - self.warmth[motor]) * TICK_S / HEAT_S

    def _hot(self) -> bool:
        if max(self.warmth) >= HOT_C and not self._fault:
            self._fault = cause("too-hot", most=HOT_C)
        return bool(self._fault)

    def samples(self) -> list[DeviceSample]:
        """Since the last call."""
        taken = list(self._taken)
        self._taken.clear()
        return taken

    # ------------------------------------------------------------------------------------- trials, and between them

    def begin(self) -> None:
        """A trial begins, and with it the account of the brakes' energy."""
        self._taken.clear()
        for brake in self.brakes:
            brake.begin()

    def end_record(self) -> dict[str, Any]:
        """The report, for a recording."""
        return {"link": self.report()}

    def report(self) -> dict[str, Any]:
        """Energies in mJ, for each motor: given (net; below zero: taken), allowed, beyond (by late ticks)."""
        return {
            "board": "HAPLY", "firmware": "not told", "samples": self._answers, "counts_per_rev": list(self._per_rev),
            "bad_answers": self._bad, "lost_links": self._lost_links,
            "given_mJ": [round(1e3 * brake.given, 3) for brake in self.brakes],
            "allowed_mJ": [round(1e3 * brake.allowance, 3) for brake in self.brakes],
            "beyond_mJ": [round(1e3 * brake.beyond, 3) for brake in self.brakes],
            "guarded": int(sum(brake.guarded for brake in self.brakes)),
            "winding_C": [round(warmth, 1) for warmth in self.warmth],
        }  # fmt: skip

    def home(self, tip: tuple[float, float]) -> None:
        """The handle is held at `tip` (m) now."""
        if not any(self.exchange((0.0,) * 4) for _ in range(FIRST_READS)):
            raise DeviceError(self.problem or "the Haply did not answer: home the encoders again")
        wanted = self.sensing.pose.counts_at(tip)
        self._offset = wanted[0] - self._counts[0], wanted[2] - self._counts[1]
        self._homed = self._hello.encoders
        self.sensing.moved()

    def zero(self) -> ZeroRecord:
        """There is no force sensor: nothing to take."""
        return NO_ZERO

    def stop(self) -> None:
        """No torque until `reset`."""
        self._fault = self._fault or cause("host-request")
        if self._wire is not None:
            self.exchange((0.0,) * 4)

    def reset(self) -> None:
        """Forget a fault. DeviceError: a motor is still hot."""
        if isinstance(self._fault, Cause) and self._fault.code == "too-hot" and max(self.warmth) > COOL_C:
            raise DeviceError(f"a motor is still at {max(self.warmth):.0f} degC: let it cool to {COOL_C:g} degC")
        self._fault = ""
