"""A board whose force channels are those of an ATI Net F/T on the network, in place of its own.

Mounting and mass beyond the sensor are the device file's, its calibration is the sensor's own, and its zero is taken
with the board's. A sensor that falls silent is a link that is lost: brakes off, and no samples until it is back.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from core.device import Device
from core.device_interface import LinkSample
from core.errors import InputError
from hardware.sensing.net_ft import CHANNELS, COUNT_UN, NetFT
from hardware.sensing.samples import BoardSensing
from hardware.serial_device import NO_CURRENT, SerialLink
from hardware.wire.messages import Hello, Sample

NET_FT = "netft:"


def link_to(device: Device, where: str) -> SerialLink:
    """The link that a text asks for: a port, or "PORT netft:HOST"."""
    port, found, host = where.partition(f" {NET_FT}")
    return NetForceLink(device, port, host) if found else SerialLink(device, port)


def check_force(text: str) -> None:
    """InputError, in one sentence, where `text` (netft:HOST) is no sensor that answers."""
    if not text.startswith(NET_FT) or text == NET_FT:
        raise InputError(f"--force: must be netft:HOST, not {text!r}")
    NetFT(text.removeprefix(NET_FT)).close()


class NetForceLink(SerialLink):
    """A board and a sensor."""

    def __init__(self, device: Device, port: str, host: str, **how: Any) -> None:
        """host: of the sensor, as `NetFT` takes it; how: as `SerialLink` takes it."""
        self._said = self._trouble = ""
        super().__init__(device, port, **how)
        self._host = host
        self._sensor: NetFT | None = None

    @property
    def problem(self) -> str:
        """Why there are no samples."""
        return self._said or self._trouble

    @problem.setter
    def problem(self, text: str) -> None:
        self._said = text

    def open(self) -> None:
        """As `SerialLink.open`; the sensor first, for a board does not wait."""
        self._sensor = NetFT(self._host)
        try:
            super().open()
        except InputError:
            self._sensor.close()
            raise

    def exchange(self, currents: Sequence[float]) -> LinkSample | None:
        """As `SerialLink.exchange`; zero currents and no sample while the sensor is silent."""
        self._trouble = self._sensor.trouble() if self._sensor else ""
        sample = super().exchange(NO_CURRENT if self._trouble else currents)
        return None if self._trouble else sample

    def report(self) -> dict:
        """With the sensor's counters."""
        return {**super().report(), "force_sensor": self._sensor.report() if self._sensor else None}

    def close(self) -> None:
        """Both."""
        super().close()
        if self._sensor:
            self._sensor.close()

    def _sensing(self, hello: Hello) -> BoardSensing:
        hello = hello._replace(force_channels=CHANNELS, force_unit=COUNT_UN)
        return BoardSensing(replace(self.device, calibration=None), hello, self.sensing)

    def _sample(self, sensing: BoardSensing, sample: Sample, now: float) -> LinkSample | None:
        assert self._sensor is not None
        return super()._sample(sensing, sample._replace(force=self._sensor.read()), now)
