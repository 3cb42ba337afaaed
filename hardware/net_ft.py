"""An ATI Net F/T force sensor on the network as the hand: its own calibration, units and counters, through `pynetft`.

The sensor streams to one client at a time. Unplugged or failing it gives no force, and is looked for until it is back.
"""

import math
from typing import Any, NamedTuple

from core.device_file import ForceSensor
from core.errors import InputError
from hardware.force_sensing import sensor_angle

#: s. A sensor streams at 1 kHz or faster; if it is silent for longer, its hand counts as gone.
SILENT_S = 0.05
START_S = 2.0  # longest wait for the first record
ZERO_RECORDS = 200  # that the zero is the mean of
#: N in the unit that the sensor is set to
UNITS_N = {"N": 1.0, "kN": 1000.0, "lbf": 4.4482216152605, "klbf": 4448.2216152605, "kgf": 9.80665}
REST = (0.0, 0.0, 0.0, 0.0)


class Reading(NamedTuple):
    """What the hand does now, and how the sensor is."""

    fx_N: float  # in the frame of the device
    fy_N: float
    connected: bool
    text: str  # for a screen: which sensor, what is wrong
    age_s: float  # since its newest record; inf before the first
    records: int  # received so far
    lost: int  # records that the network lost
    reconnects: int
    warnings: int  # records that the sensor marked as doubtful, or as wrong and of no use


class NetFT:
    """The newest force of one sensor, in the plane of the handle."""

    def __init__(self, host: str, mounting: ForceSensor, rdt_port: int = 49152, http_port: int = 80) -> None:
        """mounting: where the device file says the sensor sits. InputError: it does not answer."""
        self._host, self._mounting, self._zero = host, mounting, (0.0, 0.0)
        try:
            import pynetft

            # whatever goes wrong later, it goes on trying to connect
            config = pynetft.Config(host, rdt_port, http_port, reconnect_max_delay=1.0)
            self._client: Any = pynetft.Client(config, queue_size=ZERO_RECORDS)
            self._client.start()
        except (ImportError, OSError, ValueError) as error:  # ValueError: no host, no port
            raise InputError(f"the force sensor at {host} cannot be read: {error}") from None
        if not self._client.wait_for_first_sample(START_S):
            said = self._client.health().last_error or "another program may be reading it"
            self._client.stop()
            raise InputError(f"the force sensor at {host} sends no records: {said}")

    def read(self, theta: tuple[float, ...] = REST) -> Reading:
        """The hand now, at joint angles theta (4,) rad, which count where the sensor sits on a link.

        No force while the sensor is away, silent or failing. The inertia beyond the sensor is not taken off.
        """
        health, sample = self._client.health(), self._client.latest_sample()
        age = math.inf if health.last_record_age is None else health.last_record_age
        connected = health.state == "streaming" and age <= SILENT_S and sample is not None
        fx, fy = self._turned(sample, theta) if connected else (0.0, 0.0)
        return Reading(
            fx, fy, connected, self._text(health, connected), age, health.received_count, health.lost_count,
            health.reconnect_count, health.warning_count + health.device_error_count,
        )  # fmt: skip

    def take_bias(self) -> bool:
        """Call the mean of the next records zero force; False, and nothing changes, if they do not come."""
        forces = []
        try:
            for sample in self._client.samples(timeout=SILENT_S):
                forces.append(_newtons(sample))
                if len(forces) == 2 * ZERO_RECORDS:  # the first ones may have waited
                    break
        except TimeoutError:
            return False
        new = forces[ZERO_RECORDS:]
        if len(new) < ZERO_RECORDS:
            return False
        self._zero = (sum(fx for fx, _ in new) / len(new), sum(fy for _, fy in new) / len(new))
        return True

    def close(self) -> None:
        """Stop the stream and let the sensor go."""
        self._client.stop()

    def _turned(self, sample: Any, theta: tuple[float, ...]) -> tuple[float, float]:
        fx, fy = (force - zero for force, zero in zip(_newtons(sample), self._zero, strict=True))
        turned = sensor_angle(self._mounting, theta)
        cos, sin = math.cos(turned), math.sin(turned)
        return cos * fx - sin * fy, sin * fx + cos * fy

    def _text(self, health: Any, connected: bool) -> str:
        known = health.sensor_configuration
        name = f"{known.product_name if known else 'ATI Net F/T'} at {self._host}"
        if not connected:
            return f"{name} sends nothing: is it plugged in? ({health.last_error or health.state.value})"
        return f"{name} (status {health.last_status:#010x})" if health.last_status else name


def _newtons(sample: Any) -> tuple[float, float]:
    scale = UNITS_N[sample.force_unit.value]
    return scale * sample.force[0], scale * sample.force[1]
