"""An ATI Net F/T that is played on loopback: HTTP for its calibration, UDP for records."""

import socket
import struct
import threading
from http.server import BaseHTTPRequestHandler, HTTPServer

HOST = "127.0.0.1"
COUNTS_PER_UNIT = 1000.0


class PlayedSensor:
    """Streams the record that it holds, once asked to, every 2 ms, and says its calibration."""

    def __init__(self, unit: str = "N", torque_unit: str = "N-m") -> None:
        self.counts = (0, 0, 0, 0, 0, 0)
        self.status = 0
        self.skip = 0  # records to lose
        self.plugged = True
        self.commands: list[int] = []
        self._client: tuple | None = None
        self._rdt = self._ft = 0
        page = (
            f"<netft><prodname>Mini45</prodname><cfgcpf>{COUNTS_PER_UNIT}</cfgcpf><cfgcpt>{COUNTS_PER_UNIT}</cfgcpt>"
            f"<scfgfu>{unit}</scfgfu><scfgtu>{torque_unit}</scfgtu></netft>"
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

    @property
    def where(self) -> str:
        return f"{HOST}:{self.rdt_port}:{self.http_port}"

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
        skip = self.skip
        if skip:
            self.skip = 0  # only then: the test may set it just now
        self._rdt += 1 + skip
        self._ft += 2
        record = struct.pack(">III6i", self._rdt, self._ft, self.status, *self.counts)
        self._socket.sendto(record, self._client)
