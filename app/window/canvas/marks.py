"""The marks on the workspace: arms, rings, arrows of forces, needles of the field, SDOF directions."""

import math
from collections.abc import Iterable, Mapping

import numpy as np
from PySide6.QtCore import QLineF, QPointF, QRectF, Qt
from PySide6.QtGui import QPainter

from app.window.canvas.layers import OFF, SLIPPING, STUCK, Direction, Doing, Point, Wedge
from app.window.canvas.path_marks import paint_disc
from app.window.widgets import theme
from app.window.widgets.theme import COLOURS, pen, shade, write
from core.control.velocity_field import Field
from core.mechanism import JOINTS

PX_PER_N = 7.0  # of the arrows
ARROW_MOST_PX = 150.0  # longer ones are cut: their value stands beside them
LEAST_FORCE_N = 0.2  # weaker than this is not drawn
HEAD_PX = 8.0  # of an arrow's head
DIRECTION_PX, LETTER_PX, WEDGE_PX = 58.0, 69.0, 78.0  # length of a direction, its letter, radius of the wedge
NEEDLE_SHARE = 0.24  # half a needle's length, of the distance between two
ARMS = (("A", "E"), ("E", "D"), ("B", "C"), ("C", "D"))
SHADE = {OFF: COLOURS.brake_off, SLIPPING: COLOURS.brake_slipping, STUCK: COLOURS.brake_stuck}
JOINT_PX, BARE_PX = 12.0, 5.0  # radius of a brake's ring, and of a joint's without a brake
LETTER_WIDE_PX = 2.5  # more radius for each further letter in a ring


def paint_arms(painter: QPainter, at: Mapping[str, QPointF], width: float, core_width: float) -> None:
    """The arms between the joints (px; none where the arms do not reach). Flat, opaque lines one by one are fast.

    They seem to lie under what was painted before: each pixel keeps what stands out more from the canvas.
    """
    modes = QPainter.CompositionMode
    painter.setCompositionMode(modes.CompositionMode_Lighten if theme.is_dark() else modes.CompositionMode_Darken)
    for thick, colour in ((width, COLOURS.arm), (core_width, COLOURS.arm_core)) if at else ():
        painter.setPen(pen(colour, thick))
        for joint, other in ARMS:
            painter.drawLine(at[joint], at[other])
    painter.setCompositionMode(modes.CompositionMode_SourceOver)


def ring_radius(label: str) -> float:
    """Of a brake's ring (px): a coupling's label is wider than a letter."""
    return JOINT_PX + LETTER_WIDE_PX * (len(label) - 1)


def rings_of(at: Mapping[str, QPointF], labels: Mapping[str, str]) -> dict[str, QPointF]:
    """The middles of the joints' rings (px): brakes of coaxial bases, and couplings, stand in a row at the bases."""
    row = [joint for joint in "AECB" if joint in labels and (joint in "AB" or labels[joint] != joint)]
    if len(row) < 2 or not at:
        return dict(at)
    span, radius = QLineF(at["A"], at["B"]).length(), max(ring_radius(labels[joint]) for joint in row)
    if span >= 2.0 * radius + 2.0 and row == ["A", "B"]:
        return dict(at)
    way = (at["B"] - at["A"]) * (1.0 / span) if span > radius else QPointF(1.0, 0.0)
    middle, apart = (at["A"] + at["B"]) * 0.5, max(2.0 * radius + 4.0, span / (len(row) - 1))
    places = [way * ((k - 0.5 * (len(row) - 1)) * apart) for k in range(len(row))]
    return {**at, **{joint: middle + place for joint, place in zip(row, places, strict=True)}}


def paint_ring(painter: QPainter, middle: QPointF, radius: float, width: float, colour: str) -> None:
    """A ring and the canvas in it (px): two discs take half of the time of a circle drawn with a pen."""
    paint_disc(painter, middle, radius + 0.5 * width, colour)
    paint_disc(painter, middle, radius - 0.5 * width, COLOURS.canvas)


def paint_joints(
    painter: QPainter, rings: Mapping[str, QPointF], labels: Mapping[str, str], doing: Mapping[str, Doing] | None
) -> None:
    """A ring for each brake, in the colour of what it does, and its label; a bare ring for a joint without a brake.
    doing: None: what tells the controllers apart is hidden."""
    for joint in (joint for joint in JOINTS if joint in rings):
        if joint not in labels:
            paint_ring(painter, rings[joint], BARE_PX, 2.0, COLOURS.brake_off)
            continue
        state = (doing or {}).get(joint, Doing()).state
        paint_ring(painter, rings[joint], ring_radius(labels[joint]), 3.0, SHADE[state])
        colour = COLOURS.quiet if doing is None else COLOURS.text
        write(painter, rings[joint], labels[joint], theme.SMALL, True, colour)


def arrow_of(force: Point) -> QPointF:
    """From the tail to the head of a force's arrow, px; (0, 0) where it is too weak to be drawn."""
    size = math.hypot(*force)
    if size < LEAST_FORCE_N:
        return QPointF()
    scale = min(PX_PER_N, ARROW_MOST_PX / size)
    return QPointF(scale * force[0], -scale * force[1])


def paint_arrow(painter: QPainter, tail: QPointF, reach: QPointF, colour: str, width: float) -> None:
    """An arrow from `tail` over `reach`, px."""
    x, y = reach.x(), reach.y()
    length = math.hypot(x, y)
    if length < 1.0:
        return
    head, size = tail + reach, min(HEAD_PX, length)
    share = size / length
    foot, half = head - reach * share, QPointF(-y, x) * (0.45 * share)
    painter.setPen(pen(colour, width))
    painter.drawLine(tail, head - reach * (0.8 * share))
    painter.setPen(Qt.PenStyle.NoPen)
    painter.setBrush(shade(colour))
    painter.drawPolygon([head, foot + half, foot - half])


def paint_field(painter: QPainter, middles: np.ndarray, ways: np.ndarray, apart: float) -> None:
    """Needles, their middles (n, 2) `apart` px from each other, brighter towards their ways (n, 2), unit vectors."""
    half = NEEDLE_SHARE * apart * ways
    for first, other, alpha in ((middles - half, middles, 0.35), (middles, middles + half, 0.8)):
        painter.setPen(pen(COLOURS.brake_off, 1.0, alpha))
        painter.drawLines([QLineF(*line) for line in np.hstack((first, other)).tolist()])


def paint_directions(
    painter: QPainter, handle: QPointF, found: Iterable[Direction], field: Field, labels: Mapping[str, str]
) -> None:
    """Each brake's line; the valid sense an arrow, the chosen one strong; the desired direction as text."""
    for direction in found:
        reach = QPointF(direction.p_x, -direction.p_y) * ((direction.sense or 1.0) * DIRECTION_PX)
        painter.setPen(pen(COLOURS.quiet, 1.0, 0.6))
        painter.drawLine(handle - reach, handle + reach)
        if direction.sense:
            colour, width = (COLOURS.accent, 3.0) if direction.chosen else (COLOURS.quiet, 1.6)
            paint_arrow(painter, handle, reach, colour, width)
        beyond = handle + reach * (LETTER_PX / DIRECTION_PX)
        colour = COLOURS.text if direction.chosen else COLOURS.quiet
        write(painter, beyond, labels[JOINTS[direction.joint]], theme.SMALL, True, colour)
    paint_arrow(painter, handle, QPointF(field.beta_x, -field.beta_y) * (0.6 * DIRECTION_PX), COLOURS.text, 1.6)


def paint_wedge(painter: QPainter, handle: QPointF, found: Wedge, radius: float = WEDGE_PX) -> None:
    """The wedge and, in it, each brake by itself."""
    painter.setPen(Qt.PenStyle.NoPen)
    painter.setBrush(shade(COLOURS.wedge, 0.24))
    box = QRectF(handle.x() - radius, handle.y() - radius, 2.0 * radius, 2.0 * radius)
    first, span = math.degrees(found.first), math.degrees(found.last - found.first)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing, False)  # a third of the time; the edges below are smooth
    painter.drawPie(box, round(16.0 * first), round(16.0 * span))  # sixteenths of a degree
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    painter.setPen(pen(COLOURS.wedge_edge, 1.2))
    for angle in found.spokes:
        painter.drawLine(handle, handle + QPointF(math.cos(angle), -math.sin(angle)) * radius)
    painter.setBrush(Qt.BrushStyle.NoBrush)
    painter.drawArc(box, round(16.0 * first), round(16.0 * span))
