"""Both palettes: legible, of the same meaning, chosen on the command line; and room on a small screen at 200 %."""

import json
import os

import pytest

from app.progress import LEAST_ROOM, ScreenCheck
from app.window.widgets import theme
from app.window.widgets.palette import PALETTES, Palette

OF_TEXT, OF_MARKS = 4.5, 3.0  # WCAG 2, level AA


def contrast(one: str, other: str) -> float:
    """Of two colours, 1 to 21 (WCAG 2); 4.5 is enough for text."""
    brighter, darker = sorted((luminance(one), luminance(other)), reverse=True)
    return (brighter + 0.05) / (darker + 0.05)


def luminance(colour: str) -> float:
    parts = [int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5)]
    red, green, blue = (p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


@pytest.mark.parametrize("palette", PALETTES.values(), ids=PALETTES)
def test_every_text_and_every_mark_stands_out_from_what_is_behind_it(palette: Palette) -> None:
    p = palette
    grounds = (p.ground, p.panel, p.canvas)
    texts = [(text, ground) for text in (p.text, p.quiet, p.good, p.caution, p.bad) for ground in grounds]
    texts += [(text, p.field) for text in (p.text, p.quiet)]
    texts += [(p.text, p.accent_ground), (p.bad_text, p.bad_ground), (p.quiet, p.bad_ground), (p.on_bad, p.bad)]
    texts += [(p.brake_slipping, p.canvas), (p.brake_stuck, p.canvas)]  # beside their brakes
    texts += [(p.brake_slipping, p.panel), (p.trace, p.panel)]  # in the ledger of energy
    letters = [theme.mixed(joint, p.text, theme.OF_TEXT).name() for joint in p.joints]
    texts += [(letter, ground) for letter in letters for ground in (p.panel, p.canvas)]
    assert {pair for pair in texts if contrast(*pair) < OF_TEXT} == set()
    on_canvas = (p.handle, p.pointer, p.end_ring, p.good, p.trace, p.brake_off, p.brake_slipping, p.brake_stuck)
    marks = [(mark, p.canvas) for mark in on_canvas]
    marks += [(mark, p.panel) for mark in (*p.joints, *p.controllers, p.accent)]
    assert {pair for pair in marks if contrast(*pair) < OF_MARKS} == set()


@pytest.mark.parametrize(("screen", "scale", "shrinks"), [((1920, 1080), "2", True), ((2560, 1440), "2", False)])
def test_on_a_screen_with_little_room_all_is_drawn_smaller(monkeypatch, tmp_path, screen, scale, shrinks) -> None:
    width, height = screen
    layout = {"name": "one", "x": 0, "y": 0, "width": width, "height": height, "logicalDpi": 96, "dpr": 1}
    (tmp_path / "screens.json").write_text(json.dumps({"screens": [{**layout, "logicalBaseDpi": 96}]}))
    monkeypatch.chdir(tmp_path)  # Qt does not take the colon of a drive
    monkeypatch.setenv("QT_QPA_PLATFORM", "offscreen:configfile=screens.json")
    monkeypatch.setenv("QT_SCALE_FACTOR", scale)
    ScreenCheck("draw on").check()
    after = float(os.environ["QT_SCALE_FACTOR"])
    assert (after < float(scale)) == shrinks
    assert width / after >= LEAST_ROOM[0] - 1 and height / after >= LEAST_ROOM[1] - 1
