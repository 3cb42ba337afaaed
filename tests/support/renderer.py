"""Pictures of one line, and where Qt's renderer draws it."""

import numpy as np
from PySide6.QtCore import QByteArray, QRectF
from PySide6.QtGui import QImage, QPainter
from PySide6.QtSvg import QSvgRenderer
from scipy.spatial import cKDTree

PIXELS = 1200  # of the larger side of an image
LINE = '<path d="M5 10 C 30 70 60 -20 90 50 l -20 35"/>'
#: Attributes of the picture (else a view box of 100 x 100), what is in it.
DRAWINGS = {
    "relative commands": ("", '<path d="m10 10 l20 5 30 40 h20 v-30 h-10"/>'),
    "absolute and repeated commands": ("", '<path d="M10,10L30 15 60,55H80 70V20"/>'),
    "smooth cubics": ("", '<path d="M10 50 c10-40 20-40 30 0 s 20 40 30 0 S 80 20 90 60"/>'),
    "quadratics": ("", '<path d="M10 50 Q 25 5 40 50 T 70 50 t 20 -10"/>'),
    "a large arc": ("", '<path d="M30 50 A 25 25 0 1 1 60 70"/>'),
    "a small turned arc, flags without spaces": ("", '<path d="M20 50a30 15 40 0140 20"/>'),
    "an arc whose radii are too small": ("", '<path d="M20 50 A 5 5 0 0 1 80 60"/>'),
    "a closed line": ("", '<path d="M10 10 L 80 20 L 50 90 z"/>'),
    "a polyline": ("", '<polyline points="10,10 40,60 70 20 90,80"/>'),
    "a polygon": ("", '<polygon points="10 10, 40 60, 70 20"/>'),
    "a rounded rectangle": ("", '<rect x="10" y="20" width="70" height="40" rx="12" ry="8"/>'),
    "a circle": ("", '<circle cx="50" cy="40" r="30"/>'),
    "an ellipse in a flat picture": ('viewBox="0 0 200 100"', '<ellipse cx="100" cy="50" rx="80" ry="30"/>'),
    "a view box with an origin": (
        'viewBox="-50 -20 100 60" width="80mm" height="48mm"',
        '<path d="M-40 0L20 30 40-10"/>',
    ),
    "a view box that is stretched": (
        'viewBox="0 0 100 100" width="40mm" height="20mm" preserveAspectRatio="none"',
        LINE,
    ),
    "a style sheet": (
        "",
        f'<style>.no {{display: none}} path {{fill: none}}</style>{LINE}<path class="no" d="M0 0L9 90"/>',
    ),
    "what is hidden": (
        "",
        '<path d="M0 0L90 5" style="display:none"/><g visibility="hidden"><path d="M0 0L90 9"/>'
        f'<g visibility="visible">{LINE}</g></g><g display="none">{LINE}</g>',
    ),
    "definitions": ("", f'<defs><path d="M0 0L90 5"/></defs>{LINE}'),
    "a used line": ("", '<defs><path id="a" d="M0 0 L 60 20 L 30 70"/></defs><use href="#a" x="15" y="10"/>'),
    "a used symbol": ("", f'<symbol id="s">{LINE}</symbol><use href="#s" transform="scale(0.8 0.5)"/>'),
}


def picture(inside, attributes=""):
    about = attributes if "viewBox" in attributes else f'viewBox="0 0 100 100" {attributes}'
    pen = 'fill="none" stroke="black" vector-effect="non-scaling-stroke"'
    space = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
    return f"<svg {space} {about}><g {pen}>{inside}</g></svg>"


def is_drawn(points, text):
    """Whether the line through the points (n, 2), 1 wide with its middle at 0, is what a renderer draws."""
    line, drawn = _dense(points), _rendered(text)
    if drawn is None:
        return False
    apart = max(cKDTree(line).query(drawn)[0].max(), cKDTree(drawn).query(line)[0].max())
    return bool(apart < 4.0 / PIXELS * max(1.0, np.ptp(line)))  # a few pixels


def _rendered(text):
    """Where Qt's renderer draws (n, 2), y upwards, the drawing moved to its middle and 1 wide; None: nowhere."""
    renderer = QSvgRenderer(QByteArray(text.replace(" href=", " xlink:href=").encode()))
    size = renderer.defaultSize()
    whole = _ink(renderer, size.width() / size.height())
    if not len(whole):
        return None
    scale = renderer.viewBoxF().width() / size.width()
    if scale == renderer.viewBoxF().height() / size.height():  # not stretched: drawn again, as large as it may be
        low, high = whole.min(axis=0) - 5, whole.max(axis=0) + 6
        box, pixel = renderer.viewBoxF(), renderer.viewBoxF().width() / _shape(size.width() / size.height())[0]
        part = QRectF(box.x() + pixel * low[0], box.y() + pixel * low[1], *(pixel * (high - low)).tolist())
        renderer.setViewBox(part)
        whole = _ink(renderer, part.width() / part.height())
    points = whole * (1.0, -1.0)
    low, high = points.min(axis=0), points.max(axis=0)
    return (points - 0.5 * (low + high)) / (high - low)[0]


def _shape(aspect):
    return (PIXELS, round(PIXELS / aspect)) if aspect > 1.0 else (round(PIXELS * aspect), PIXELS)


def _ink(renderer, aspect):
    """The black pixels (n, 2) of an image."""
    width, height = _shape(aspect)
    image = QImage(width, height, QImage.Format.Format_Grayscale8)
    image.fill(255)
    painter = QPainter(image)
    renderer.render(painter)
    painter.end()
    grey = np.frombuffer(image.constBits(), np.uint8).reshape(height, image.bytesPerLine())
    y, x = np.nonzero(grey[:, :width] < 128)
    return np.column_stack([x, y]).astype(float)


def _dense(points):
    """Points of a line, a two-hundredth of a per cent of its length apart."""
    way = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
    even = np.linspace(0.0, way[-1], 20_000)
    return np.column_stack([np.interp(even, way, points[:, k]) for k in range(2)])
