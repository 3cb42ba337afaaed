"""The board's clock by the host's: offset and drift, from the times at which samples arrive.

A sample arrives at least the wire's shortest delay after it was taken. So only the quickest sample of each second
counts. A straight line through those of the last minute gives host time = offset + (1 + drift) board time; its slope is
the median of all slopes between two of them (Theil and Sen: a quarter of the points may be wrong). The offset contains
the wire's shortest delay, which is less than the shortest round trip of a heartbeat.
"""

from collections import deque
from typing import NamedTuple

import numpy as np

from hardware.wire.messages import Flag, Sample

BLOCK_S = 1.0  # of board time: of each such block the quickest sample counts
BLOCKS = 60
#: s; where the quickest samples of so many blocks in a row are all so far from the line, a clock has jumped (the host
#: slept, the board was held up), and earlier ones are forgotten.
STEP_S, STEP_BLOCKS = 0.005, 3

#: s. A longer standstill of the host's clock, in one step or several, is a doubt. Shorter than the lateness at which a
#: board refuses a command (board.LATE_US), by how much a command's travel time may vary.
STOOD_STILL_S = 0.04
LEARN_S = 1.0  # of board time, after which the quickest sample's delay is known
DRIFT = 2e-4  # most that the two clocks run apart: four crystals of 50 ppm. Assumed
LATE_S = 0.2  # all commands are late for this long


class ClockFit(NamedTuple):
    """host time (s) = offset_s + (1 + drift) board time (s)."""

    offset_s: float
    drift: float
    residual_s: float  # median distance of the quickest samples from the line
    blocks: int  # how many quickest samples it is made from; with fewer than three there is no drift yet


class ClockModel:
    """The line through the quickest samples, fitted again after each block."""

    def __init__(self) -> None:
        self.went_back = 0  # how often the board's clock went back, which it must not: the model then starts again
        self._newest_us = 0
        self.begin()

    def begin(self) -> None:
        """Forget everything: one of the clocks was interrupted."""
        self.fit = ClockFit(0.0, 0.0, 0.0, 0)
        self._quickest: deque[tuple[float, float]] = deque(maxlen=BLOCKS)  # board s, host s less board s
        self._block: tuple[float, float] | None = None  # the quickest of the running block
        self._block_end = 0.0

    def add(self, board_us: int, host_s: float) -> None:
        """Add a sample taken at `board_us` that arrived at `host_s`."""
        if board_us < self._newest_us:
            self.went_back += 1
            self.begin()
        self._newest_us = board_us
        board_s = 1e-6 * board_us
        behind = host_s - board_s
        if self._block is None:
            self._block, self._block_end = (board_s, behind), board_s + BLOCK_S
        elif behind < self._block[1]:
            self._block = (board_s, behind)
        if board_s >= self._block_end:
            self._quickest.append(self._block)
            self._block = None
            self._forget_before_a_step()
            self.fit = fit_line(np.array(self._quickest))
        elif self.fit.blocks == 0 and self._block is not None:
            self.fit = ClockFit(self._block[1], 0.0, 0.0, 0)

    def went_on(self, board_us: int, asked_s: float) -> bool:
        """Whether a board has had power since its newest sample. Asked at host time `asked_s`, it answers `board_us`.

        Else its clock has gone back, or began after that sample. Without an earlier sample the answer is yes.
        """
        if board_us < self._newest_us:
            return False
        return self.fit.blocks == 0 and self._block is None or asked_s - 1e-6 * board_us < self.host_s(self._newest_us)

    def _forget_before_a_step(self) -> None:
        newest = list(self._quickest)[-STEP_BLOCKS:]
        if len(self._quickest) > STEP_BLOCKS and all(
            abs(behind - self.fit.offset_s - self.fit.drift * board_s) > STEP_S for board_s, behind in newest
        ):
            self._quickest.clear()
            self._quickest.extend(newest)

    def host_s(self, board_us: int) -> float:
        """The host time at which the board time was `board_us`."""
        return self.fit.offset_s + (1.0 + self.fit.drift) * 1e-6 * board_us


def fit_line(points: np.ndarray) -> ClockFit:
    """Fit points (n, 2): board time, host time less board time, s."""
    board, behind = points[:, 0], points[:, 1]
    drift = 0.0
    if len(points) >= 3:
        i, j = np.triu_indices(len(points), 1)
        drift = float(np.median((behind[j] - behind[i]) / (board[j] - board[i])))
    left = behind - drift * board
    offset = float(np.median(left))
    return ClockFit(offset, drift, float(np.median(np.abs(left - offset))), len(points))


class FreshnessWatch:
    """Watches whether the board still accepts commands as fresh: the host's side of docs/protocol.md, "Commands".

    A board calls a command late by both clocks. If the host's clock stood still (a paused virtual machine, an aborted
    suspend), every command is late from then on, for minutes. Only reconnecting helps: freshness then starts again, and
    the currents are zero until some are commanded.
    """

    def __init__(self) -> None:
        self._began = self._last = 0.0  # board s
        self._least: float | None = None  # s: host time less board time of the quickest samples. None: no sample yet
        self._late: tuple[float, int] | None = None  # since when (host s) commands are late, and the echo since then

    def doubt(self, sample: Sample, came_s: float) -> str:
        """Why the board must be reconnected, one sentence; "": it need not be. came_s: host time."""
        stood = self._stood_still(1e-6 * sample.board_us, came_s)
        if stood > STOOD_STILL_S:
            return f"this computer's clock stood still for {1e3 * stood:.0f} ms; the board is being reconnected"
        if self._late is None or self._late[1] != sample.echo:  # a command was accepted
            self._late = (came_s, sample.echo) if sample.flags & Flag.LATE else None
        elif came_s - self._late[0] > LATE_S:
            return "the board takes every command for late; it is being reconnected"
        return ""

    def _stood_still(self, board_s: float, came_s: float) -> float:
        """How much earlier a sample came than the quickest before it, s: only a clock can cause that."""
        behind = came_s - board_s
        if self._least is None or board_s < self._last:  # the first one, or the board's clock went back
            self._began, self._least = board_s, behind
        drifted = DRIFT * (board_s - self._last)
        self._last = board_s
        if board_s - self._began < LEARN_S:
            self._least = min(self._least, behind)
            return 0.0
        earlier = self._least - behind
        self._least += min(max(-earlier, -drifted), drifted)
        return earlier
