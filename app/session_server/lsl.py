"""Two streams of the Lab Streaming Layer (LSL) for other recorders: every tick of a session's trials, and markers.

`phd run --lsl` asks for them. The session server opens them when it starts. The recorder's thread pushes the ticks that
it has taken from the ring, so that the loop does nothing for them. A marker is a JSON text: a line of the journal, or
that a phase of a trial begins. Times are LSL's: the steady clock of the loop plus an offset measured for each chunk.
"""

import json
import os
import shlex
import socket
import sys
import threading
import time
import zlib
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from app.ipc.ring import MOST_BEHIND_NS, Ring
from core import tick_log
from core.files import InputError
from experiments.store.journal import Event

TICKS, MARKERS = "PHD ticks", "PHD markers"
HZ = 1000.0
READINGS = 5  # at both clocks, for each chunk
#: where liblsl looks for settings of its own (and where the variable LSLAPICFG says)
SETTINGS = (Path("lsl_api.cfg"), Path.home() / "lsl_api/lsl_api.cfg", Path("/etc/lsl_api/lsl_api.cfg"))
ONLY_ERRORS = "[log]\nlevel = -2\n"
CODES = {
    "phase": "; " + ", ".join(f"{code} {phase}" for code, phase in enumerate(tick_log.PHASES)),
    "stuck": " (bits: 1 A, 2 E, 4 B, 8 C)",
    "decision": " (a code; recordings hold the word)",
}


def load_pylsl() -> Any:
    """The library. InputError: it is not there, and what to type."""
    try:
        import pylsl
    except (ImportError, RuntimeError) as error:  # RuntimeError: it finds no liblsl
        problem = "pylsl is not installed" if isinstance(error, ImportError) else "pylsl finds no library liblsl"
        raise InputError(
            f"--lsl: {problem}. Type: {shlex.join([sys.executable, '-m', 'pip', 'install', 'pylsl'])}"
        ) from None
    return pylsl


class Outlets:
    """Both streams, open until the process ends."""

    def __init__(self, ring: Ring, real: bool, data_dir: Path) -> None:
        """real: the ticks are those of a device on the bench. InputError: pylsl is not there."""
        pylsl = load_pylsl()
        if "LSLAPICFG" not in os.environ and not any(file.exists() for file in SETTINGS):
            pylsl.set_config_content(ONLY_ERRORS)
        self._ring, self._real, self._clock = ring, real, pylsl.local_clock
        whose = tick_log.BENCH if real else tick_log.SIMULATED
        columns = [column for kind in tick_log.COLUMNS if kind.of in (tick_log.BOTH, whose) for column in kind.spread()]
        self._columns = [column.place for column in columns]
        where = f"{socket.gethostname()}-{zlib.crc32(str(data_dir).encode()):08x}"
        info = pylsl.StreamInfo(TICKS, "Misc", len(columns), HZ, "double64", f"phd-ticks-{where}")
        channels = info.desc().append_child("channels")
        for column in columns:
            channel = channels.append_child("channel")
            channel.append_child_value("label", column.name)
            channel.append_child_value("unit", column.unit)
            channel.append_child_value("meaning", column.meaning + CODES.get(column.name, ""))
        clock = info.desc().append_child("clock")
        clock.append_child_value("stamps", "when each tick was due by the loop's steady clock, plus offset_s")
        clock.append_child_value("offset_s", f"{self._offset_s():.9f}")
        clock.append_child_value("offset_meaning", "LSL's clock less the steady clock; measured anew for each chunk")
        self._ticks = pylsl.StreamOutlet(info)
        info = pylsl.StreamInfo(MARKERS, "Markers", 1, pylsl.IRREGULAR_RATE, "string", f"phd-markers-{where}")
        self._markers = pylsl.StreamOutlet(info)
        self._marking = threading.Lock()  # both the recorder's thread and the server's own set markers
        self._run, self._phase = 0, np.nan
        self._zero_s: float | None = None  # the loop's clock at `t_s` = 0; None: no tick of the trial was seen yet
        self.failure = ""  # why nothing more is sent

    def begin(self, run: int) -> Callable[[np.ndarray], None]:
        """Begin a trial; returns what takes its ticks."""
        self._run, self._phase, self._zero_s = run, np.nan, None
        return self._send_ticks

    def mark(self, event: Event, about: dict[str, Any]) -> None:
        """Send a line of the journal as a marker."""
        age_s = 0.0
        if at := about.get("time"):  # it waited for the recorder's thread
            age_s = (datetime.now(UTC) - datetime.fromisoformat(at)).total_seconds()
        fields = {name: value for name, value in about.items() if name != "time"}
        self._mark(self._clock() - max(0.0, age_s), event=event.name, **fields)

    def _mark(self, stamp_s: float, **about: Any) -> None:
        with self._marking:
            self._send(self._markers.push_sample, [json.dumps(about)], stamp_s)

    def _send_ticks(self, rows: np.ndarray) -> None:
        """Send the next ticks (n, width) of the trial, n > 0."""
        stamps_s = self._due_s(rows) + self._offset_s()
        self._send(self._ticks.push_chunk, rows[:, self._columns], stamps_s)
        phases = rows[:, tick_log.PHASE]
        for at in np.flatnonzero(np.diff(phases, prepend=self._phase)):
            self._mark(stamps_s[at], event="phase", run=self._run, phase=tick_log.PHASES[int(phases[at])])
        self._phase = phases[-1]

    def _due_s(self, rows: np.ndarray) -> np.ndarray:
        """When each tick was due, (n,) s of the loop's clock."""
        t = rows[:, tick_log.T]
        if self._real:  # the time of its sample; where that was lost, of the last one before it
            zeros = rows[:, tick_log.HOST_S] - t
            known = np.flatnonzero(np.isfinite(zeros))
            before = np.searchsorted(known, np.arange(len(rows)), side="right") - 1
            first = self._zero_s if self._zero_s is not None else zeros[known[0]] if len(known) else time.perf_counter()
            zeros = np.concatenate([[first], zeros[known]])[before + 1]
            self._zero_s = zeros[-1]
            return zeros + t
        if self._zero_s is None:
            self._zero_s = 1e-9 * int(self._ring.control.begun) - t[0]
        late_s = 1e-6 * rows[:, tick_log.LATENESS_US]
        waits = np.cumsum(np.where(late_s >= 1e-9 * MOST_BEHIND_NS, late_s, 0.0))  # the ticks behind wait as long
        zeros = self._zero_s + np.concatenate([[0.0], waits[:-1]])
        self._zero_s += waits[-1]
        return zeros + t

    def _offset_s(self) -> float:
        """LSL's clock less the loop's, by the quickest of some readings: a delayed reading is wrong by its delay."""
        readings = []
        for _ in range(READINGS):
            before_s, lsl_s, after_s = time.perf_counter(), self._clock(), time.perf_counter()
            readings.append((after_s - before_s, lsl_s - 0.5 * (before_s + after_s)))
        return min(readings)[1]

    def _send(self, push: Callable[..., None], data: Any, stamps_s: Any) -> None:
        """Send; a failure ends the streams and never the recording."""
        if not self.failure:
            try:
                push(data, stamps_s)
            except RuntimeError as error:
                self.failure = f"The LSL streams have ended ({error}). The recording goes on."
