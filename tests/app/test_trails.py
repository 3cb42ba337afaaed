"""The trail is the movement: what is painted of it beside every tick of the recording, frames dropped at random."""

from collections.abc import Sequence

import numpy as np
import pytest
from drawn_ways import Pieces, frames, trail_of, way_of
from fake_client import PLAN, before, movement, opened, ready, running
from screens import Screens
from tried import tried

from app.ipc import messages as m
from app.window.canvas.plane import Plane
from app.window.widgets.page import RUN, TRY
from core import tick_log

SEEDS = range(2)
WITHIN_PX = 1.0
Said = dict[int, list[object]]  # after so many ticks of all: what the server says


def whole(path: int, generator: np.random.Generator) -> np.ndarray:
    """A trial from approach to end: a hand that trembles, swings out to 11 mm, and is fast at the end."""
    moved = movement(path, "AEB", float(generator.uniform(0.4, 1.2)), 2.0)
    t = np.arange(len(moved)) / len(moved)
    moved[:, tick_log.TIP_X] += 0.011 * np.sin(2.0 * np.pi * 3.0 * t) * t + 0.0004 * np.sin(2.0 * np.pi * 60.0 * t)
    moved[:, tick_log.TIP_Y] += 0.011 * np.cos(2.0 * np.pi * 5.0 * t) * t**2
    parts = [np.repeat(moved[:1], n, axis=0) for n in (150, 60)] + [moved, np.repeat(moved[-1:], 120, axis=0)]
    rows = np.concatenate(parts)
    phases = tick_log.APPROACH, tick_log.HOLD, tick_log.MOVE, tick_log.END
    rows[:, tick_log.PHASE] = np.repeat(phases, [len(part) for part in parts])
    rows[:, tick_log.T] = 1e-3 * np.arange(len(rows))
    return rows


def play(
    screens: Screens, views: Sequence[Plane], rows: np.ndarray, said: Said, generator: np.random.Generator
) -> None:
    """Ticks and messages as they come, painted at some of the frames."""
    for first, until in frames(rows, generator):
        due = [message for tick in sorted(said) if tick <= until for message in said.pop(tick)]
        screens.client.rows, screens.client.taken = rows[first:until], True
        screens.hear(*due)
        if generator.random() < 0.7:
            for view in views:
                view.grab()
    assert not said
    for view in views:
        view.grab()


@pytest.mark.parametrize("seed", SEEDS)
def test_in_a_session_both_windows_paint_every_tick_of_a_movement_whichever_frames_are_dropped(
    screens: Screens, monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    generator, pieces = np.random.default_rng(seed), Pieces(monkeypatch)
    screens.hear(opened(), ready(0))
    screens.main.show_page(RUN)
    screens.participant.resize(1280, 720)
    screens.participant.show()
    views = screens.run.workspace.view, screens.participant.view
    trials = [whole(PLAN[over].path, generator) for over in range(3)]
    for begun in ((0,), (1, 2)):  # one alone; one after the other without a pause
        rows, said, at = np.concatenate([trials[one] for one in begun]), Said(), 0
        for one in begun:
            said[at + int(generator.integers(0, 40))] = [running(one)]
            at += len(trials[one])
            said[at] = [ready(one + 1)]
        play(screens, views, rows, said, generator)
        for view in views:
            newest = trials[begun[-1]]
            assert np.array_equal(trail_of(view), way_of(newest)), "a tick of the movement is missing, or one too many"
            assert pieces.furthest_px(view, newest) < WITHIN_PX
    screens.participant.hide()


def a_pass(begun: int) -> m.Snapshot:
    """This pass of Try is running."""
    now = tried()
    return now._replace(running=now.running._replace(repetition=begun))


@pytest.mark.parametrize("seed", SEEDS)
def test_try_paints_every_tick_of_a_pass_whichever_frames_are_dropped(screens, monkeypatch, seed) -> None:
    generator, pieces = np.random.default_rng(seed), Pieces(monkeypatch)
    screens.hear(opened(""), before())
    screens.main.show_page(TRY)
    canvas = screens.main.pages[TRY].canvas  # type: ignore[attr-defined]
    passes = [whole(1, generator) for _ in range(4)]
    for begun in ((0,), (1, 2, 3)):  # pass follows pass: there is no word of an end between two of them
        rows, said, at = np.concatenate([passes[one] for one in begun]), Said(), 0
        for one in begun:
            said[at + int(generator.integers(0, 40))] = [a_pass(one + 1)]
            at += len(passes[one])
        play(screens, [canvas], rows, said, generator)
        assert np.array_equal(trail_of(canvas), way_of(passes[begun[-1]]))
        assert pieces.furthest_px(canvas, passes[begun[-1]]) < WITHIN_PX
