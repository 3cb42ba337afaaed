"""A live session over the emulated board's pseudo-terminal, for tests: made ready and led through trials as a person
does it, again where a busy machine held the processes up and the board, rightly, took its current off.
"""

import contextlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
from emulated import Emulated
from live import Window, live_window
from protocols import PAPER, changed
from waiting import LONG_S, wait_until

from app.ipc import messages as m
from app.ipc.messages import Setup
from core import tick_log
from core.path import Segment
from experiments.analysis.trials_table import TrialRow
from experiments.store.cells import cell

DEVICE = "four-brake"
BRAKING = (2, 4)  # controllers that act on everybody
AGAIN_S = 3.0  # after which what was asked for is asked for again
STARTS_S = 30.0  # after which a trial that was neither begun nor refused is started again
MOST_TRIES = 10  # of a trial that the machine spoils
CURRENTS = slice(tick_log.CURRENT, tick_log.CURRENT + 4)


def lets_go(snapshot: m.Snapshot) -> bool:
    """Whether the person is asked to let go of the handle: the zero comes next."""
    return snapshot.card is not None and snapshot.card.text.startswith("Let go of the handle")


class BoardSession:
    """A window on a bench with the emulated board, whose operator goes to and fro."""

    def __init__(self, emulated: Emulated, window: Window) -> None:
        self.emulated, self.window = emulated, window

    @property
    def folder(self) -> Path:
        return Path(self.window.opened.folder)

    def device(self) -> m.Check:
        return next(check for check in self.window.snapshot.checks if check.name == "Device")

    def open(self) -> None:
        """A session; the device waits for its zero."""
        self.window.until_stage(m.NO_SESSION)
        self.window.client.send(m.Open("01"))
        self.window.until(lambda s: lets_go(s))

    def allow(self) -> None:
        """Brakes are allowed, or the board comes back."""
        self._do_what_is_asked(lambda s: self.device().state == m.GOOD and not s.brakes_off)

    def make_ready(self) -> None:
        """What the bench asks for is done until a trial may start: zero, brakes allowed; or the board comes back."""
        self._do_what_is_asked(lambda s: not s.trial_blocker)

    def _do_what_is_asked(self, until: Callable[[m.Snapshot], bool]) -> None:
        allowed = confirmed = 0.0  # when
        end, away = time.perf_counter() + 0.6 * LONG_S, False
        while True:
            self.window.look()
            now, snapshot = time.perf_counter(), self.window.snapshot
            if until(snapshot):
                break
            assert now < end, f"nothing can be started; the last was {snapshot}"
            if snapshot.brakes_off and now - allowed > AGAIN_S:
                allowed = now
                self.window.client.send(m.AllowBrakes())
            elif lets_go(snapshot) and now - confirmed > AGAIN_S:
                away = True
                self.rest()
                confirmed = time.perf_counter()
                self.window.client.send(m.Confirm())
            time.sleep(0.005)
        if away:
            self.emulated.order(away=False)

    def rest(self) -> None:
        """Nobody holds the handle, and it rests."""
        self.emulated.order(away=True)

        def still() -> bool:
            truth = self.emulated.order()
            return max(map(abs, truth["velocity_m_s"] + truth["hand_force_N"])) < 1e-3

        wait_until(still)

    def begin(self) -> int:
        """Start a trial; its run. It is in its movement and stays there: the operator goes astray again and again, and
        currents flow.
        """
        window = self.window
        for _ in range(MOST_TRIES):
            self.make_ready()
            while window.snapshot.coming.controller not in BRAKING:
                coming = window.snapshot.coming
                window.client.send(m.Skip("the brakes may never act"))
                window.until(lambda s, before=coming: s.coming != before)
            path = window.opened.protocol.paths[window.snapshot.coming.path]
            self.emulated.order(path=msgspec.to_builtins(astray(path)))
            window.ticks.clear()
            before = window.snapshot.notice
            window.client.send(m.Start())
            window.within(STARTS_S, lambda s, old=before: s.stage == m.RUNNING or s.notice_bad and s.notice != old)
            if window.snapshot.stage == m.RUNNING:
                run = window.snapshot.running.run
                if self._in_movement():
                    return run
        raise AssertionError(f"no trial comes to its movement; the last was {window.snapshot}")

    def _in_movement(self) -> bool:
        """Whether the trial comes to its movement, and to currents, before something ends it."""
        window = self.window

        def there() -> bool:
            window.look()
            rows = window.ticks[-1]
            return len(rows) > 0 and rows[-1, tick_log.PHASE] == tick_log.MOVE and rows[-1, CURRENTS].any()

        wait_until(lambda: there() or window.snapshot.stage != m.RUNNING)
        return window.snapshot.stage == m.RUNNING

    def row(self, run: int) -> TrialRow:
        """The row of a run, when it is there; a run that was cut short comes again next."""
        window = self.window
        found = next(r for r in window.until(lambda s: any(r.run == run for r in s.rows)).rows if r.run == run)
        assert (found.status == "done") != (cell(found) == cell(window.snapshot.coming))
        return found

    def cut_short(self, act: Callable[[], object], says: str) -> TrialRow:
        """The row of a trial that this ended in its movement, so that the experimenter reads this."""
        for _ in range(MOST_TRIES):
            run = self.begin()
            act()
            found = self.row(run)
            if says in self.window.snapshot.notice:
                return found
            self.emulated.order(clear=True)
        raise AssertionError(f"{self.window.snapshot.notice} and never {says}")


def astray(path: Segment) -> Segment:
    """To 60 mm beside the middle of a path: the brakes act soon."""
    x, y = (0.5 * (a + b) for a, b in zip(path.start_m, path.end_m, strict=True))
    return Segment(path.start_m, (x, y - 0.06))


@contextlib.contextmanager
def board_session(folder: Path, link: str = "{port}", *arguments: str) -> Iterator[BoardSession]:
    """A session on an emulated board of its own; at the end the board is without current.

    link: as Setup takes it; arguments: more of `phd emulate`.
    """
    protocol = folder / "patient.toml"
    protocol.write_text(changed(PAPER.text, time_out_s="200.0", hold_s="0.0", start_radius_m="0.04"), encoding="utf-8")
    emulated = Emulated(folder, "--device", DEVICE, "--hand", "operator", "--seed", "3", *arguments)
    try:
        where = link.format(port=emulated.port)
        setup = Setup(folder / "data", str(protocol), devices=(DEVICE,), link=where, sync=False)
        with live_window(setup) as opened:
            yield BoardSession(emulated, opened)

        def left() -> bool:
            truth = emulated.order()
            return truth["currents_mA"] == [0] * 4 and truth["state"] in ("IDLE", "FAULT")

        wait_until(left)
    finally:
        emulated.end()
