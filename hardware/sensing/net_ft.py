"""An ATI Net F/T force sensor on the network, through `pynetft`: its own calibration, units and counters.

The sensor streams to one client at a time. Unplugged or failing it is looked for until it is back.
"""

import math
from typing import Any

from core.files import InputError

NET_FT = "netft:"  # begins the name of one
RDT_PORT, HTTP_PORT = 49152, 80  # that every Net F/T has
#: s. A sensor streams at 1 kHz or faster; if it is silent for longer, it counts as gone.
SILENT_S = 0.05
START_S = 2.0  # longest wait for the first record
CHANNELS = 6  # Fx Fy Fz Tx Ty Tz
COUNT_UN = 100  # micro-newtons (and micro-newton metres) in a count of `read`: finer than any of these sensors
#: N, and N m, in the units that the sensor may be set to
UNITS_N = {"N": 1.0, "kN": 1000.0, "lbf": 4.4482216152605, "klbf": 4448.2216152605, "kgf": 9.80665}
UNITS_N_M = {
    "N-m": 1.0, "N-mm": 1e-3, "kN-m": 1000.0, "lbf-in": 0.1129848290276167, "lbf-ft": 1.3558179483314004,
    "kgf-cm": 0.0980665,
}  # fmt: skip


class NetFT:
    """A force sensor on the network."""

    def __init__(self, where: str) -> None:
        """where: HOST, or HOST:UDP-PORT:HTTP-PORT. InputError: it does not answer."""
        self.host, _, ports = where.partition(":")
        self._counts = (0,) * CHANNELS
        try:
            rdt_port, http_port = map(int, ports.split(":")) if ports else (RDT_PORT, HTTP_PORT)
            import pynetft

            # whatever goes wrong later, it goes on trying to connect
            config = pynetft.Config(self.host, rdt_port, http_port, reconnect_max_delay=1.0)
            self._client: Any = pynetft.Client(config)
            self._client.start()
        except (ImportError, OSError, ValueError) as error:  # ValueError: no host, no port
            raise InputError(f"the force sensor at {where} cannot be read: {error}") from None
        if not self._client.wait_for_first_sample(START_S):
            reason = self._client.health().last_error or "another program may be reading it"
            self._client.stop()
            raise InputError(f"the force sensor at {where} sends no records: {reason}")

    def read(self) -> tuple[int, ...]:
        """The newest load (CHANNELS,) in counts of COUNT_UN."""
        if (sample := self._client.latest_sample()) is not None:
            force, torque = UNITS_N[sample.force_unit.value], UNITS_N_M[sample.torque_unit.value]
            self._counts = tuple(
                round(1e6 / COUNT_UN * scale * value)
                for scale, axes in ((force, sample.force), (torque, sample.torque))
                for value in axes
            )
        return self._counts

    def trouble(self) -> str:
        """Why the newest record is out of date; "": it is not."""
        health = self._client.health()
        age = math.inf if health.last_record_age is None else health.last_record_age
        if health.state == "streaming" and age <= SILENT_S:
            return ""
        return f"the force sensor at {self.host} sends nothing: {health.last_error or 'is it plugged in?'}"

    def report(self) -> dict:
        """Identity and counters of the sensor, as JSON holds them."""
        health = self._client.health()
        known = health.sensor_configuration
        return {
            "name": known.product_name if known else "", "host": self.host, "records": health.received_count,
            "lost": health.lost_count, "reconnects": health.reconnect_count, "status": health.last_status,
            "doubtful": health.warning_count + health.device_error_count,
        }  # fmt: skip

    def close(self) -> None:
        self._client.stop()


def check_force(text: str) -> None:
    """InputError if `text` (netft:HOST) is no sensor that answers."""
    if not text.startswith(NET_FT) or text == NET_FT:
        raise InputError(f"--force: must be netft:HOST, not {text!r}")
    NetFT(text.removeprefix(NET_FT)).close()
