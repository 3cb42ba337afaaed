"""Whether the board still takes for fresh what is sent: the host's end of docs/protocol.md, "Commands".

A board calls a command late by its own clock and the host's. Where the host's clock stood still (a virtual machine that
was paused, a suspend that was given up), every command is late from then on, for minutes. Only a new connection helps:
with it freshness begins anew, and the currents are zero until somebody asks for some.
"""

from hardware.wire.messages import Flag, Sample

#: s. The clock stood still for longer than this (or as long in several steps). Below what makes a board call a command
#: late (freshness.LATE_US) by what the way of a command may vary.
STOOD_STILL_S = 0.04
LEARN_S = 1.0  # of board time, after which the quickest sample's way is known
DRIFT = 2e-4  # most that the two clocks run apart: four crystals of 50 ppm. Assumed
LATE_S = 0.2  # all commands late for so long


class FreshnessWatch:
    """Looks at every sample of one connection."""

    def __init__(self) -> None:
        self._began = self._last = 0.0  # board s
        self._least: float | None = None  # s: host time less board time of the quickest samples. None: no sample yet
        self._late: tuple[float, int] | None = None  # since when (host s) commands are late, and the echo since then

    def doubt(self, sample: Sample, came_s: float) -> str:
        """Why the connection must begin anew, one sentence; "": the board can tell what is fresh. came_s: host time."""
        stood = self._stood_still(1e-6 * sample.board_us, came_s)
        if stood > STOOD_STILL_S:
            return f"this computer's clock stood still for {1e3 * stood:.0f} ms, the board is being connected anew"
        if self._late is None or self._late[1] != sample.echo:  # one was taken in
            self._late = (came_s, sample.echo) if sample.flags & Flag.LATE else None
        elif came_s - self._late[0] > LATE_S:
            return "the board takes every command for late, it is being connected anew"
        return ""

    def _stood_still(self, board_s: float, came_s: float) -> float:
        """How much earlier a sample came than the quickest before it, s: nothing is quicker but by a clock."""
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
