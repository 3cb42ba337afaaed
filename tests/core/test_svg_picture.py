"""Lines of SVG pictures: where a renderer draws them, or refused."""

import numpy as np
import pytest
from PySide6.QtCore import QByteArray
from PySide6.QtGui import QImage, QPainter
from PySide6.QtSvg import QSvgRenderer
from scipy.spatial import cKDTree

from core.drawn_path import read_path
from core.files import InputError
from core.svg_picture import shown_lines

pytestmark = pytest.mark.nojit

PIXELS = 1200  # of the larger side of an image
LINE = '<path d="M5 10 C 30 70 60 -20 90 50 l -20 35"/>'
#: Attributes of the picture (else a view box of 100 x 100), what is in it.
PLAIN = {
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
NESTED = {
    "translate on a path": ("", '<path transform="translate(10,20)" d="M0 0 L 60 20 L 50 60"/>'),
    "rotate about a point": (
        "",
        '<g transform="translate(5 -5)"><path transform="rotate(30 50 50)" d="M20 50L80 60 60 20"/></g>',
    ),
    "scale within rotate": (
        "",
        f'<g transform="rotate(20)"><g transform="translate(20,0) scale(0.7,0.4)">{LINE}</g></g>',
    ),
    "skew within scale": ("", f'<g transform="scale(0.6)"><g transform="skewX(25)">{LINE}</g></g>'),
    "an arc that is skewed": (
        "",
        '<g transform="translate(0 10)"><path transform="skewY(20)" d="M20 20A30 20 30 1 1 60 50"/></g>',
    ),
    "a circle that is skewed": (
        "",
        '<g transform="skewX(-20) translate(30)"><circle transform="scale(1 .5)" cx="40" cy="50" r="25"/></g>',
    ),
    "a matrix within a matrix": (
        "",
        f'<g transform="matrix(.5 .1 -.2 .6 20 10)"><g transform="matrix(1,0,0.3,1,5,0)">{LINE}</g></g>',
    ),
    "several transforms in one": (
        "",
        f'<g transform="translate(50 50) rotate(-40),scale(.5)translate(-50,-50)">{LINE}</g>',
    ),
    "a used group in a group": (
        "",
        f'<defs><g id="a" transform="rotate(10)">{LINE}</g></defs>'
        '<g transform="scale(.6)"><use href="#a" x="30" y="10" transform="rotate(5)"/></g>',
    ),
    "three groups, millimetres and a view box": (
        'viewBox="-20 -20 150 150" width="210mm" height="210mm"',
        '<g transform="translate(5)"><g transform="scale(1,-1)"><g transform="translate(0,-100) rotate(8)">'
        f"{LINE}</g></g></g>",
    ),
}
DRAWINGS = PLAIN | NESTED


def picture(inside, attributes=""):
    about = attributes if "viewBox" in attributes else f'viewBox="0 0 100 100" {attributes}'
    pen = 'fill="none" stroke="black" vector-effect="non-scaling-stroke"'
    space = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
    return f"<svg {space} {about}><g {pen}>{inside}</g></svg>"


def rendered(text):
    """Where Qt's renderer draws (n, 2), x to the right, y upwards, the drawing moved to its middle and 1 wide."""
    renderer = QSvgRenderer(QByteArray(text.replace("href=", "xlink:href=").encode()))
    assert renderer.isValid()
    size = renderer.defaultSize()
    scale = PIXELS / max(size.width(), size.height())
    image = QImage(round(size.width() * scale), round(size.height() * scale), QImage.Format.Format_Grayscale8)
    image.fill(255)
    painter = QPainter(image)
    renderer.render(painter)
    painter.end()
    grey = np.frombuffer(image.constBits(), np.uint8).reshape(image.height(), image.bytesPerLine())
    y, x = np.nonzero(grey[:, : image.width()] < 128)
    return placed(np.column_stack([x, -y]).astype(float))


def placed(points):
    low, high = points.min(axis=0), points.max(axis=0)
    return (points - 0.5 * (low + high)) / (high - low)[0]


def dense(points):
    """The points of a line at most a fiftieth of a per cent of its width apart."""
    steps = np.hypot(*np.diff(points, axis=0).T)
    way = np.append(0.0, np.cumsum(steps))
    even = np.linspace(0.0, way[-1], 20_000)
    return np.column_stack([np.interp(even, way, points[:, k]) for k in range(2)])


@pytest.mark.parametrize("attributes, inside", DRAWINGS.values(), ids=DRAWINGS)
def test_the_path_of_a_picture_is_where_a_renderer_draws_it(attributes, inside):
    text = picture(inside, attributes)
    entry = {"kind": "drawing", "file": "it.svg", "width_m": 1.0, "centre_m": [0.0, 0.0]}
    path, _ = read_path(entry, lambda _: text, "path 1")
    line, drawn = dense(np.array(path.points_m)), rendered(text)
    away = max(cKDTree(line).query(drawn)[0].max(), cKDTree(drawn).query(line)[0].max())
    assert away < 4.0 / PIXELS * max(1.0, np.ptp(line)), "in widths of the drawing: a few pixels"


@pytest.mark.parametrize(
    ("inside", "number"),
    [
        ("", 0),
        (LINE + LINE, 2),
        ('<path d="M0 0L1 1M2 2L3 3z l 1 1"/>', 3),
        ('<path d=""/><path/><path d="M 5 5"/><path d="M 5 5 L 5 5"/><line x1="1" y1="1" x2="1" y2="1"/>', 0),
        (
            '<clipPath id="c"><rect width="9" height="9"/></clipPath>'
            '<marker id="m"><path d="M0 0L5 5"/></marker><mask id="k"><path d="M0 0L5 5"/></mask>' + LINE,
            1,
        ),
        ('<pattern id="m"><path d="M0 0L5 5"/></pattern><symbol id="k"><path d="M0 0L5 5"/></symbol>', 0),
        ('<text x="5" y="5">words</text><metadata><a><path d="M0 0L5 5"/></a></metadata>' + LINE, 1),
        ('<path d="M0 0L5 5" stroke="none"/><path d="M0 0L5 5" opacity="0"/>' + LINE, 1),
        (LINE.replace("/>", ' class="no"/>') + "<style>.no {display:none !important}</style>", 0),
        ('<switch><foreignObject/><g class="a  b">' + LINE + "</g></switch>", 1),
        ('<use href="#a"/><defs style="display:none"><g id="a">' + LINE + "</g></defs>", 1),
    ],
)
def test_what_is_not_drawn_is_no_line(inside, number):
    assert len(shown_lines(picture(inside), "it.svg")) == number


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("<svg", "is no SVG picture that can be read"),
        ("<html/>", "is no SVG picture: its first element is html"),
        (picture('<path d="M 0 0 L 1"/>'), "is no SVG picture that can be read"),
        (picture('<path d="M 0 0 H"/>'), "is no SVG picture that can be read"),
        (picture('<path d="M 0 0 L 9 9 # 3"/>'), "d of path is 'M 0 0 L 9 9 # 3'"),
        (picture('<path d="M 0,,5 L 9 9"/>'), "d of path"),
        (picture('<path d="L 1 1 L 9 9"/>'), "d of path"),
        (picture('<path d="M0 0 A 1 1 0 0"/>'), "is no SVG picture that can be read"),
        (picture('<polyline points="1 2 3"/>'), "points of polyline is '1 2 3'"),
        (picture(f'<g transform="rotate(20">{LINE}</g>'), r"transform of g is 'rotate\(20'"),
        (picture(f'<g transform="rotate(20, 3)">{LINE}</g>'), "transform of g"),
        (picture(f'<g transform="turn(20)">{LINE}</g>'), "transform of g"),
        (picture(f'<g style="transform: rotate(20deg)">{LINE}</g>'), "a style sets transform, which is"),
        (picture(f"<style>path {{transform: none}}</style>{LINE}"), "a style sets transform"),
        (picture(f'<g transform-origin="5 5">{LINE}</g>'), "g has a transform-origin"),
        (picture(f"<style>g > path {{display: none}}</style>{LINE}"), "its style sheet decides by 'g > path'"),
        (picture('<use href="#gone"/>'), "a use refers to #gone, which is not in the picture"),
        (picture('<g id="a"><use href="#a"/></g>'), "a use refers to itself"),
        (picture(f'<symbol id="s" viewBox="0 0 9 9">{LINE}</symbol><use href="#s"/>'), "a symbol has a viewBox"),
        (
            picture(
                f'<g id="l0">{LINE}</g>'
                + "".join(f'<g id="l{i + 1}">{f"""<use href="#l{i}"/>""" * 10}</g>' for i in range(9))
            ),
            "more than 10000 elements",
        ),
    ],
)  # fmt: skip
def test_a_picture_that_cannot_be_read_for_sure_is_refused_in_a_sentence(text, says):
    with pytest.raises(InputError, match=f"^it.svg: .*{says}"):
        shown_lines(text, "it.svg")
