"""ATI Net F/T as the hand, against a sensor that is played on loopback: HTTP for its calibration, UDP for records."""

import math
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest

from core.device_file import ForceSensor
from core.errors import InputError
from hardware.net_ft import NetFT, Reading

pytest.importorskip("pynetft", reason="pynetft is not installed: ATI sensors cannot be read")

HOST = "127.0.0.1"
COUNTS_PER_UNIT = 1000.0


class PlayedSensor:
    """Streams the record that it holds, once asked to, every 2 ms, and says its calibration."""

    def __init__(self, unit: str = "N") -> None:
        self.counts = (0, 0, 0, 0, 0, 0)
        self.status = 0
        self.skip = 0  # records to lose
        self.plugged = True
        self.commands: list[int] = []
        self._client: tuple | None = None
        self._rdt = self._ft = 0
        page = (
            f"<netft><prodname>Mini45</prodname><cfgcpf>{COUNTS_PER_UNIT}</cfgcpf><cfgcpt>{COUNTS_PER_UNIT}</cfgcpt>"
            f"<scfgfu>{unit}</scfgfu><scfgtu>N-m</scfgtu></netft>"
        ).encode()

        class Page(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                self.send_response(200 if self.path == "/netftapi2.xml" else 404)
                self.send_header("Content-Type", "text/xml")
                self.send_header("Content-Length", str(len(page)))
                self.end_headers()
                self.wfile.write(page)

            def log_message(self, *_: object) -> None:
                pass

        self._web = HTTPServer((HOST, 0), Page)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((HOST, 0))
        self._socket.settimeout(0.002)
        self.http_port, self.rdt_port = self._web.server_port, self._socket.getsockname()[1]
        self._ended = threading.Event()
        self._threads = [threading.Thread(target=self._web.serve_forever, args=(0.01,)),
                         threading.Thread(target=self._stream)]  # fmt: skip
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        self._ended.set()
        self._web.shutdown()
        for thread in self._threads:
            thread.join()
        self._web.server_close()
        self._socket.close()

    def _stream(self) -> None:
        while not self._ended.is_set():
            try:
                data, client = self._socket.recvfrom(100)
            except TimeoutError:
                self._send()
                continue
            magic, command, _ = struct.unpack(">HHI", data)
            assert magic == 0x1234
            self.commands.append(command)
            self._client = {0: None, 2: client}.get(command, self._client)

    def _send(self) -> None:
        if self._client is None or not self.plugged:
            return
        self._rdt, self.skip = self._rdt + 1 + self.skip, 0
        self._ft += 2
        record = struct.pack(">III6i", self._rdt, self._ft, self.status, *self.counts)
        self._socket.sendto(record, self._client)


@pytest.fixture
def sensor() -> Iterator[PlayedSensor]:
    played = PlayedSensor()
    yield played
    played.close()


@pytest.fixture
def hand(sensor: PlayedSensor) -> Iterator[NetFT]:
    reader = opened(sensor)
    yield reader
    reader.close()


def opened(sensor: PlayedSensor, rotation_rad: float = 0.0, on: str = "handle") -> NetFT:
    mounting = ForceSensor(on=on, rotation_rad=rotation_rad)
    return NetFT(HOST, mounting, sensor.rdt_port, sensor.http_port)


def once(hand: NetFT, told: Callable[[Reading], bool], within_s: float = 5.0) -> Reading:
    """The first reading of which this is true."""
    end = time.monotonic() + within_s
    while time.monotonic() < end:
        reading = hand.read()
        if told(reading):
            return reading
        time.sleep(0.002)
    raise AssertionError(reading)


def test_the_force_is_counts_by_the_sensors_own_calibration(sensor: PlayedSensor, hand: NetFT) -> None:
    sensor.counts = (12_500, -3000, 7, 8, 9, 10)
    reading = once(hand, lambda r: r.fx_N != 0.0)
    assert (reading.fx_N, reading.fy_N) == (12.5, -3.0)
    assert reading.connected and reading.text == f"Mini45 at {HOST}" and reading.age_s < 0.05


@pytest.mark.parametrize(("unit", "newtons"), [("lbf", 4.4482216152605), ("kgf", 9.80665), ("kN", 1000.0)])
def test_other_units_become_newtons(unit: str, newtons: float) -> None:
    sensor = PlayedSensor(unit)
    try:
        sensor.counts = (2000, 0, 0, 0, 0, 0)
        hand = opened(sensor)
        assert hand.read().fx_N == pytest.approx(2.0 * newtons, rel=1e-12)
        hand.close()
    finally:
        sensor.close()


def test_the_mounting_turns_the_force_and_so_does_a_link_that_carries_the_sensor(sensor: PlayedSensor) -> None:
    sensor.counts = (10_000, 0, 0, 0, 0, 0)
    for on, theta, turned in (("handle", (1.0, 2.0, 3.0, 4.0), 0.5), ("ED", (0.3, 0.4, 9.0, 9.0), 1.2)):
        hand = opened(sensor, rotation_rad=0.5, on=on)
        reading = hand.read(theta)
        assert (reading.fx_N, reading.fy_N) == pytest.approx((10 * math.cos(turned), 10 * math.sin(turned)))
        hand.close()


def test_what_the_sensor_says_at_rest_is_taken_off(sensor: PlayedSensor, hand: NetFT) -> None:
    sensor.counts = (4000, -2000, 0, 0, 0, 0)
    assert hand.take_bias()
    assert hand.read()[:2] == pytest.approx((0.0, 0.0))
    sensor.counts = (5000, -2000, 0, 0, 0, 0)
    assert once(hand, lambda r: abs(r.fx_N) > 0.5)[:2] == pytest.approx((1.0, 0.0))


def test_an_unplugged_sensor_gives_no_force_and_works_again_within_two_seconds(
    sensor: PlayedSensor, hand: NetFT
) -> None:
    sensor.counts = (9000, 9000, 0, 0, 0, 0)
    once(hand, lambda r: r.fx_N == 9.0)
    sensor.plugged = False
    gone = once(hand, lambda r: not r.connected)
    assert (gone.fx_N, gone.fy_N) == (0.0, 0.0) and "sends nothing" in gone.text
    assert not hand.take_bias()
    sensor.plugged = True
    back = once(hand, lambda r: r.connected, within_s=2.0)
    assert back.fx_N == 9.0 and back.reconnects >= 1


def test_lost_records_are_counted(sensor: PlayedSensor, hand: NetFT) -> None:
    once(hand, lambda r: r.records > 3)
    sensor.skip = 7
    assert once(hand, lambda r: r.lost > 0).lost == 7


def test_records_that_the_sensor_calls_wrong_are_no_force(sensor: PlayedSensor, hand: NetFT) -> None:
    sensor.counts = (1000, 0, 0, 0, 0, 0)
    once(hand, lambda r: r.fx_N == 1.0)
    sensor.status = 0x80020000  # a gauge is saturated or broken
    sensor.counts = (60_000, 0, 0, 0, 0, 0)
    failing = once(hand, lambda r: r.warnings > 0)
    assert failing.fx_N in (0.0, 1.0)
    assert once(hand, lambda r: not r.connected).fx_N == 0.0


@pytest.mark.parametrize("dead", [True, False], ids=["nobody answers", "no records come"])
def test_a_sensor_that_is_silent_from_the_start_is_refused(
    sensor: PlayedSensor, dead: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hardware.net_ft.START_S", 0.3)
    sensor.plugged = False
    if dead:
        sensor.http_port = 1
    with pytest.raises(InputError, match=f"the force sensor at {HOST} sends no records: .+"):
        opened(sensor)


def test_a_host_without_a_name_is_refused(sensor: PlayedSensor) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        NetFT("", ForceSensor(on="handle"))


def test_closing_stops_the_stream(sensor: PlayedSensor) -> None:
    hand = opened(sensor)
    hand.close()
    end = time.monotonic() + 2.0
    while sensor.commands[-1] != 0 and time.monotonic() < end:
        time.sleep(0.002)
    assert sensor.commands[0] in (0, 2) and sensor.commands[-1] == 0
