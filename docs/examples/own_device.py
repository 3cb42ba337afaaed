"""A driver for hardware of your own (docs/bench.md): fill in `Bus`, phd run --link driver:FILE.py"""

import time

from core.device_interface import DeviceError
from core.faults import cause
from hardware.emulated_board.device import hello_of
from hardware.sensing.samples import BoardSensing, zero_of
from hardware.wire.messages import Sample, State


class Bus:
    """The hardware. By itself it takes all current off 50 ms after the last `exchange`, and then reads a fault."""

    def exchange(self, currents_mA):
        """Currents (4,) to the brakes at A, E, B, C; then None, if nothing comes within 4 ms, or what is read:

        its time (us), encoder counts, force counts, current (mA) of each brake, and its `Fault` (NONE: none).
        """
        raise OSError("the bus of this driver is not filled in yet")


class OwnDevice:
    port, encoders, force_channels = "my bus", "AB", 6

    def __init__(self, device, bus, clock=time.perf_counter):
        self.device, self.bus, self.clock, self.problem = device, bus, clock, "not opened yet"
        self.hello = hello_of(device, "OWN-1")._replace(force_unit=1000)  # encoders and brakes as in the device file
        self._sequence, self._taken, self._flags, self._stopped = 0, [], 0, ""

    def open(self):
        self.sensing, self.problem = BoardSensing(self.device, self.hello), ""
        self._offset = [0] * len(self.encoders)

    def exchange(self, currents):
        most = self.device.brakes.current_max * (not self._stopped)
        try:
            read = self.bus.exchange([round(1e3 * min(max(i, 0.0), m)) for i, m in zip(currents, most, strict=True)])
        except OSError as error:
            self.problem = str(error)
            return None
        if read is None:
            return None
        board_us, self._raw, force, current_mA, fault = read
        self._sequence += 1
        counts = tuple(map(sum, zip(self._raw, self._offset, strict=True)))
        state, echo = State.FAULT if fault else State.READY, self._sequence
        now = (self._sequence, echo, board_us, state, self._flags, fault, fault, counts, force, current_mA)
        self.sensing.fault = self._stopped
        self._taken.append(self.sensing.take(Sample(*now), self.clock()))
        return self._taken[-1]

    def samples(self):
        taken, self._taken = self._taken, []
        return taken

    def home(self, tip):
        wanted = [self.sensing.pose.counts_at(tip)["AEBC".index(joint)] for joint in self.encoders]
        self._offset = [count - raw for count, raw in zip(wanted, self._raw, strict=True)]
        self._flags = self.hello.encoders
        self.sensing.moved()

    def zero(self):
        taken = [self.exchange([0.0] * 4) for _ in range(500)]
        if None in taken:
            raise DeviceError("zero: not every sample came")
        self.sensing.set_zero(zero_of(taken, self.sensing.zero))
        return self.sensing.zero

    @property
    def zeroed(self):
        return self.sensing.zero.samples > 0

    def stop(self):
        self._stopped = cause("host-request")

    def reset(self):
        self._stopped = ""  # and let the hardware forget its own fault; DeviceError if the cause still stands

    def report(self):
        per_rev = [n for n in self.hello.counts_per_rev if n]
        return {"board": "OWN-1", "firmware": "1.0", "samples": self._sequence, "counts_per_rev": per_rev}

    def end_record(self):
        return {"link": self.report()}

    def begin(self):
        self._taken.clear()

    def close(self):
        self.exchange([0.0] * 4)


def new_device(device):
    return OwnDevice(device, Bus())
