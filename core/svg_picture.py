"""The lines that an SVG picture shows, as points: with its transforms, `use`, view box and units; y downwards.

The library reads leniently: what it would pass over in silence is left out here, or refused, before it sees it.
"""

import io
import math
import re
from collections.abc import Iterator
from typing import Any
from xml.etree import ElementTree

import numpy as np

from core.files import InputError, naming_errors

CURVE_POINTS = 32  # on each curve, and on each quarter turn of an arc
MOST_ELEMENTS = 10_000  # with each `use` in full
_SVG = "{http://www.w3.org/2000/svg}"
_HREFS = ("href", "{http://www.w3.org/1999/xlink}href")
_SHAPES = ("path", "circle", "ellipse", "line", "polyline", "polygon", "rect")
#: Elements that show something by themselves or by their children; of others nothing is drawn as a line.
_KNOWN = (*_SHAPES, "svg", "g", "a", "switch", "use", "defs", "symbol", "style")
#: Of CSS: what decides where a line is and whether it is seen.
_DECIDES = re.compile(r"(?:^|[;{\s])(display|visibility|opacity|transform[\w-]*|d|stroke|fill)\s*:")
_SELECTOR = re.compile(r"\*|[\w-]*(?:[.#][\w-]+)?")
_POINTS = re.compile(r"[-+.,eE\d\s]*", re.ASCII)
#: Of the data of a path: how many numbers each command takes at a time, and what they look like.
_TAKES = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7, "Z": 0}
_COMMAND = re.compile(r"\s*([MLHVCSQTAZ])", re.IGNORECASE)
_NUMBER = re.compile(r"\s*,?\s*[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?", re.IGNORECASE | re.ASCII)
_FLAG = re.compile(r"\s*,?\s*[01]")
_TRANSFORM = re.compile(r"(matrix|translate|scale|rotate|skewX|skewY)\s*\(([-+.,eE\d\s]*)\)[\s,]*", re.ASCII)
_NUMBERS_OF = {"matrix": (6,), "translate": (1, 2), "scale": (1, 2), "rotate": (1, 3), "skewX": (1,), "skewY": (1,)}


def shown_lines(text: str, where: str) -> list[np.ndarray]:
    """The separate lines (n, 2) of a picture in the order in which they are drawn, curves as many short pieces.

    What is not shown is left out: `display`, `visibility`, no stroke and no fill, and what stands in `defs`, a marker
    or a clip path. Clip paths and masks hide nothing here. InputError: it cannot be read, or not surely.
    """
    import svgelements

    with naming_errors(f"{where}: is no SVG picture that can be read"):
        root = _plain(ElementTree.fromstring(text), where)
        source = io.BytesIO(ElementTree.tostring(root))
        picture = svgelements.SVG.parse(source, reify=False, on_error="raise")
        shapes = [element for element in picture.elements() if isinstance(element, svgelements.Shape)]
        return [line for shape in shapes if _is_seen(shape.values) for line in _lines(svgelements.Path(shape))]


def _plain(root: ElementTree.Element, where: str) -> ElementTree.Element:
    """The picture without what is no line, its style sheets first and its symbols where only `use` finds them."""
    if _name(root) != "svg":
        raise InputError(f"{where}: is no SVG picture: its first element is {root.tag}")
    styles, symbols = ElementTree.Element(f"{_SVG}g"), ElementTree.Element(f"{_SVG}defs")
    for parent in list(root.iter()):
        for child in list(parent):
            if not isinstance(child.tag, str) or _name(child) not in _KNOWN:
                parent.remove(child)
            elif _name(child) in ("style", "symbol"):
                parent.remove(child)
                (styles if _name(child) == "style" else symbols).append(child)
    root.insert(0, symbols)
    for number, style in enumerate(styles):
        _check_sheet(style, where)
        root.insert(number, style)
    for element in root.iter():
        _check_element(element, where)
    _refuse_endless(root, where)
    return root


def _name(element: ElementTree.Element) -> str:
    return element.tag.removeprefix(_SVG)


def _check_sheet(style: ElementTree.Element, where: str) -> None:
    """InputError where a style sheet decides what is seen by more than the name, class or id of an element."""
    sheet = re.sub(r"/\*.*?\*/|!important", "", style.text or "", flags=re.DOTALL)
    style.text = sheet
    for selectors, rule in re.findall(r"([^{}]*)\{([^{}]*)\}?", sheet):
        for selector in selectors.split(","):
            if _DECIDES.search(rule) and not _SELECTOR.fullmatch(selector.strip()):
                raise InputError(f"{where}: its style sheet decides by {selector.strip()!r}, which is not read")
        _check_style(rule, where)


def _check_style(rule: str, where: str) -> None:
    if found := re.search(r"(?:^|[;{\s])(transform[\w-]*|d)\s*:", rule):
        raise InputError(f"{where}: a style sets {found[1]}, which is read as an attribute only")


def _check_element(element: ElementTree.Element, where: str) -> None:
    """InputError where an attribute says something that would be passed over."""
    name = _name(element)
    if name == "path":
        element.attrib.setdefault("d", "")
    if style := element.get("style"):
        element.set("style", style.replace("!important", ""))
        _check_style(style, where)
    if "transform-origin" in element.attrib:
        raise InputError(f"{where}: {name} has a transform-origin, which is not read: apply its transform first")
    if name == "symbol" and "viewBox" in element.attrib:
        raise InputError(f"{where}: a symbol has a viewBox, which is not read: unlink the clones of the symbol")
    if not _is_path_data(data := element.get("d", "")):
        raise InputError(f"{where}: is no SVG picture that can be read (d of {name} is {data!r})")
    points = element.get("points", "")
    if not _POINTS.fullmatch(points) or len(_numbers(points)) % 2 or re.search(r",\s*,", points):
        raise InputError(f"{where}: is no SVG picture that can be read (points of {name} are {points!r})")
    if (transform := element.get("transform")) is not None:
        parts = _TRANSFORM.findall(transform)
        wrong = any(len(_numbers(numbers)) not in _NUMBERS_OF[kind] for kind, numbers in parts)
        if wrong or _TRANSFORM.sub("", transform).strip():
            raise InputError(f"{where}: is no SVG picture that can be read (transform of {name} is {transform!r})")


def _is_path_data(data: str) -> bool:
    """Whether the data of a path are whole: each command with all its numbers, arcs with flags of 0 and 1."""
    if data.strip()[:1] not in ("", "M", "m"):
        return False
    at = 0
    while command := _COMMAND.match(data, at):
        kind, at, sets = command[1].upper(), command.end(), 0
        while (end := _end_of_set(kind, data, at)) > at:
            at, sets = end, sets + 1
        if not sets and kind != "Z":
            return False
    return not data[at:].strip() and not re.search(r"[A-Za-z]\s*,", data)


def _end_of_set(kind: str, data: str, at: int) -> int:
    """Where the numbers end that a command takes at a time; `at`: they are not all there."""
    end = at
    for k in range(_TAKES[kind]):
        found = (_FLAG if kind == "A" and k in (3, 4) else _NUMBER).match(data, end)
        if not found:
            return at
        end = found.end()
    return end


def _numbers(text: str) -> list[str]:
    return re.findall(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?", text)


def _refuse_endless(root: ElementTree.Element, where: str) -> None:
    """InputError where a `use` refers to nothing, or to what holds it, or where they make too many elements."""
    ids = {element.get("id"): element for element in root.iter() if "id" in element.attrib}
    sizes: dict[ElementTree.Element, float] = {}

    def size(element: ElementTree.Element) -> float:
        if element not in sizes:
            sizes[element] = math.inf  # until it is known: what is within must not refer to it
            total = 1 + sum(size(child) for child in element)
            if _name(element) == "use":
                href = next((element.attrib[key] for key in _HREFS if key in element.attrib), "")
                if href.removeprefix("#") not in ids:
                    raise InputError(f"{where}: a use refers to {href or 'nothing'}, which is not in the picture")
                total += size(ids[href.removeprefix("#")])
            sizes[element] = total
        return sizes[element]

    if size(root) > MOST_ELEMENTS:
        raise InputError(f"{where}: a use refers to itself, or there are more than {MOST_ELEMENTS} elements")


def _is_seen(values: dict) -> bool:
    """Whether a shape shows, by its attributes and those that it inherits."""
    if values.get("visibility") in ("hidden", "collapse") or values.get("opacity") in ("0", "0%"):
        return False
    return values.get("stroke", "none") != "none" or values.get("fill") != "none"


def _lines(path: Any) -> Iterator[np.ndarray]:
    """The lines of a path where its transform puts them."""
    import svgelements

    line: list[tuple[float, float]] = []
    start = (0.0, 0.0)
    for segment in path.segments(transformed=False):
        if isinstance(segment, svgelements.Move):
            yield from _moved(line, path.transform)
            start = (segment.end.x, segment.end.y)
            line = [start]
            continue
        if not line:  # a command after a close goes on from where the closed line began
            line = [start]
        if isinstance(segment, svgelements.Arc):
            count = CURVE_POINTS * max(1, math.ceil(abs(segment.sweep) / (0.5 * math.pi)))
        elif isinstance(segment, svgelements.Line | svgelements.Close):
            count = 1
        else:
            count = CURVE_POINTS
        points = [segment.point(k / count) for k in range(1, count)] + [segment.end]
        line += [(point.x, point.y) for point in points]
        if isinstance(segment, svgelements.Close):
            yield from _moved(line, path.transform)
            line = []
    yield from _moved(line, path.transform)


def _moved(line: list[tuple[float, float]], transform: Any) -> Iterator[np.ndarray]:
    """The line after a transform, if it has any length."""
    points = np.array(line)
    if len(points) > 1 and np.ptp(points, axis=0).any():
        matrix = np.array([[transform.a, transform.b], [transform.c, transform.d]])
        yield points @ matrix + (transform.e, transform.f)
