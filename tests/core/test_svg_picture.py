"""Lines of SVG pictures: where a renderer draws them, or refused."""

import numpy as np
import pytest
from renderer import DRAWINGS, LINE, is_drawn, picture

from core.drawn_path import read_path
from core.files import InputError
from core.svg_picture import shown_lines


@pytest.mark.parametrize("attributes, inside", DRAWINGS.values(), ids=DRAWINGS)
def test_the_path_of_a_picture_is_where_a_renderer_draws_it(attributes, inside):
    text = picture(inside, attributes)
    entry = {"kind": "drawing", "file": "it.svg", "width_m": 1.0, "centre_m": [0.0, 0.0]}
    path, _ = read_path(entry, lambda _: text, "path 1")
    assert is_drawn(np.array(path.points_m), text)


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
        (picture('<path d="M 0 0 L 9 9 # 3"/>'), "d of path is 'M 0 0 L 9 9 # 3'"),
        (picture('<path d="M20 20A30 2030 1 1 60 50"/>'), "d of path"),
        (picture('<polyline points="1 2 3"/>'), "points of polyline are '1 2 3'"),
        (picture(f'<g transform="rotate(20">{LINE}</g>'), r"transform of g is 'rotate\(20'"),
        (picture(f'<g transform="turn(20)">{LINE}</g>'), "transform of g"),
        (picture(f'<g style="transform: rotate(20deg)">{LINE}</g>'), "a style sets transform, which is"),
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
