"""The trail is the movement: what is painted of it beside every tick of the recording, frames dropped at random."""

from collections.abc import Sequence

import numpy as np
from drawn_ways import frames, is_painted, trail_of, way_of
from fake_client import PLAN, before, movement, opened, ready, running
from PySide6.QtCore import QRectF
from PySide6.QtGui import QImage
from scipy.spatial import cKDTree
from screens import Screens
from tried import tried

from app.window.canvas.plane import Plane
from app.window.widgets.page import TRY
from core import tick_log

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


def play(screens: Screens, views: Sequence[Plane], trials: Sequence[np.ndarray], said: Said) -> None:
    """Ticks and messages as they come, painted at some of the frames; the newest trial is then seen whole."""
    rows, generator = np.concatenate(trials), np.random.default_rng(len(trials))
    for first, until in frames(rows, generator):
        due = [message for tick in sorted(said) if tick <= until for message in said.pop(tick)]
        screens.client.rows, screens.client.taken = rows[first:until], True
        screens.hear(*due)
        if generator.random() < 0.7:
            for view in views:
                view.grab()
    assert not said
    for view in views:
        assert np.array_equal(trail_of(view), way_of(trials[-1])), "a tick of the movement is missing, or too many"
        assert is_painted(view)


def test_in_a_session_both_windows_paint_every_tick_of_a_movement_whichever_frames_are_dropped(screens) -> None:
    generator = np.random.default_rng(1)
    screens.hear(opened(), ready(0))
    screens.participant.show()
    trials = [whole(PLAN[over].path, generator) for over in range(3)]
    for begun in ((0,), (1, 2)):  # one alone; one after the other without a pause
        said, at = Said(), 0
        for one in begun:
            said[at + int(generator.integers(0, 40))] = [running(one)]
            at += len(trials[one])
            said[at] = [ready(one + 1)]
        views = screens.run.workspace.view, screens.participant.view
        play(screens, views, [trials[one] for one in begun], said)


def test_try_paints_every_tick_of_a_pass_whichever_frames_are_dropped(screens: Screens) -> None:
    generator, now = np.random.default_rng(2), tried()
    screens.hear(opened(""), before())
    screens.main.show_page(TRY)
    passes = [whole(1, generator) for _ in range(4)]
    for begun in ((0,), (1, 2, 3)):  # pass follows pass: there is no word of an end between two of them
        said, at = Said(), 0
        for one in begun:
            running_pass = now._replace(running=now.running._replace(repetition=one + 1))
            said[at + int(generator.integers(0, 40))] = [running_pass]
            at += len(passes[one])
        play(screens, [screens.main.page(TRY).canvas], [passes[one] for one in begun], said)


def test_the_line_is_where_the_handle_was_within_two_pixels(qtbot) -> None:
    plane = Plane(QRectF(-0.13, 0.36, 0.26, 0.09))
    qtbot.addWidget(plane)
    plane.resize(600, 300)
    plane.show()
    blank = pixels_of(plane)
    way = way_of(whole(1, np.random.default_rng(3)))
    for first, until in frames(way, np.random.default_rng(4)):
        plane.extend_trail(way[first:until])
        plane.grab()
    painted = np.argwhere(pixels_of(plane) != blank)[:, ::-1] + 0.5
    drawn = plane.pixels(way)
    assert len(painted) > 300
    assert max(cKDTree(painted).query(drawn)[0].max(), cKDTree(drawn).query(painted)[0].max()) < 2.0


def pixels_of(plane: Plane) -> np.ndarray:
    image = plane.grab().toImage().convertToFormat(QImage.Format.Format_RGB32)
    return np.frombuffer(image.constBits(), np.uint32).reshape(image.height(), image.width()).copy()
