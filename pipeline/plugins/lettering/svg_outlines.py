"""Outlines of SVG drawings: what fills and strokes cover, as a browser shows it.

Colours do not count. What is more than outlines, such as text, pictures, masks and dashes, is refused.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, ParseError, fromstring

import numpy as np
import shapely
from fontTools.misc.transform import Transform
from fontTools.svgLib.path import parse_path
from shapely import affinity

from pipeline.errors import UsageError, shortened
from pipeline.plugins.lettering.outlines import OutlineShape, PolylinePen, filled
from pipeline.plugins.lettering.strokes import Stroke, stroked
from render.base.input_files import read_input

MOST_BYTES = 1 << 26
MOST_PATHS = 5000
DEEPEST = 64
"""Groups and uses within each other."""

FINE = 1e-4
"""Tolerance over the extent of a drawing for its bounds, by which it is scaled."""

GROUPS = ("svg", "g", "a", "switch")
SHAPES = ("path", "rect", "circle", "ellipse", "line", "polyline", "polygon")
REFUSED = {
    "text": "is text. Convert it to paths in the program that drew it",
    "image": "is a picture. Trace it, or remove it",
    "foreignObject": "is not a part of SVG. Remove it",
}

INITIAL: Mapping[str, str] = {
    "fill": "black",
    "fill-rule": "nonzero",
    "fill-opacity": "1",
    "stroke": "none",
    "stroke-width": "1",
    "stroke-linecap": "butt",
    "stroke-linejoin": "miter",
    "stroke-miterlimit": "4",
    "stroke-dasharray": "none",
    "stroke-opacity": "1",
    "visibility": "visible",
    "vector-effect": "none",
}
"""Properties that elements inherit, and their initial values."""

HIDING = ("clip-path", "mask", "marker-start", "marker-mid", "marker-end")
"""Properties that change what an outline shows; they are refused."""

OWN = ("display", "opacity", "transform", *HIDING)
"""Properties that elements do not inherit."""

UNITS = {"": 1.0, "px": 1.0, "pt": 96 / 72, "pc": 16.0, "mm": 96 / 25.4, "cm": 96 / 2.54, "in": 96.0}

_DECIMAL = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_NO_DATA = re.compile(r"[^MmZzLlHhVvCcSsQqTtAa0-9eE.,+\s-]")
_LENGTH = re.compile(rf"\s*({_DECIMAL})\s*([a-z%]*)\s*")
_FUNCTION = re.compile(r"[\s,]*(\w+)\s*\(([^()]*)\)[\s,]*")
_RULE = re.compile(r"([^{}]+)\{([^{}]*)\}")
_SELECTOR = re.compile(r"([\w-]+|\*)?(?:([.#])([\w-]+))?")


@lru_cache(maxsize=8)
def drawn_shapes(path: Path, size: float, tolerance: float) -> tuple[OutlineShape, ...]:
    """Return the shapes of a drawing, one a path, in the order in which they are painted.

    size       the largest extent of the drawing, whose middle is at the origin and which has y up, units
    tolerance  greatest distance from curves, units

    Raises UsageError for a file that is not SVG, for what is refused in it, and for one that shows nothing.
    """
    drawing = SvgDrawing(path)
    rough = [region for _, region in drawing.shown(drawing.fine)]
    if not rough:
        raise UsageError(
            f"{path.name} shows nothing: it has no fill or stroke within its viewBox. Choose another."
        )
    left, low, right, high = shapely.total_bounds(rough)
    scale = size / max(right - left, high - low)
    placed = [scale, 0.0, 0.0, -scale, -0.5 * scale * (left + right), 0.5 * scale * (low + high)]
    shapes = drawing.shown(tolerance / scale)
    return tuple(OutlineShape(name, affinity.affine_transform(region, placed)) for name, region in shapes)


@dataclass(frozen=True)
class DrawnPath:
    """A path with what it inherits.

    name        for messages
    data        the path in the notation of `d`
    matrix      from its coordinates to those of the drawing
    properties  those of INITIAL
    """

    name: str
    data: str
    matrix: Transform
    properties: Mapping[str, str]

    def region(self, tolerance: float) -> Any:
        """Return what its fill and stroke cover. Raises UsageError for path data that is not valid."""
        return shapely.unary_union([*self._fill(tolerance), *self._stroke(tolerance)])

    def outline(self, matrix: Transform, tolerance: float) -> PolylinePen:
        pen = PolylinePen(matrix, tolerance)
        try:
            if _NO_DATA.search(self.data):
                raise ValueError("letters that mean nothing")
            parse_path(self.data, pen)
        except Exception as error:  # the parser raises whatever it stumbles over
            fact = f"its path data {shortened(self.data)} is not valid"
            raise UsageError(f"{self.name}: {fact}. Export the drawing again.") from error
        return pen

    def _fill(self, tolerance: float) -> Iterator[Any]:
        rule = self.properties["fill-rule"]
        if self._is_painted("fill"):
            contours = self.outline(self.matrix, tolerance).contours
            yield filled(contours, "evenodd" if rule == "evenodd" else "nonzero")

    def _stroke(self, tolerance: float) -> Iterator[Any]:
        given = self.properties
        width = _length(given["stroke-width"], self.name)
        if not self._is_painted("stroke") or not width:
            return
        if given["stroke-dasharray"] not in ("none", "") or given["vector-effect"] != "none":
            raise UsageError(f"{self.name} has a stroke with dashes or of fixed width. Convert it to a path.")
        a, b, c, d, *_ = self.matrix
        pen = self.outline(Transform(), tolerance / max((a * a + b * b + c * c + d * d) ** 0.5, 1e-300))
        limit = _length(given["stroke-miterlimit"], self.name)
        stroke = Stroke(0.5 * width, given["stroke-linecap"], given["stroke-linejoin"], limit)
        covered = stroked(pen, stroke)
        yield affinity.affine_transform(covered, [a, c, b, d, self.matrix.dx, self.matrix.dy])

    def _is_painted(self, paint: str) -> bool:
        colour, opacity = self.properties[paint], self.properties[f"{paint}-opacity"]
        return colour not in ("none", "transparent") and not re.fullmatch(r"0*\.?0*%?", opacity)


class SvgDrawing:
    """The paths of a drawing, and the box that they are seen in, in units of the drawing.

    Raises UsageError as `drawn_shapes`.
    """

    def __init__(self, path: Path) -> None:
        self.name = path.name
        try:
            root = fromstring(read_input(path, MOST_BYTES))
        except (ParseError, ValueError, LookupError) as error:
            raise UsageError(f"{self.name} is not SVG: {error}. Export it again.") from None
        if _tag(root) != "svg":
            raise UsageError(
                f"{self.name} is not SVG: it begins with {shortened(root.tag)}. Export it again."
            )
        self.ids = {element.get("id"): element for element in root.iter() if element.get("id")}
        self.rules = [
            rule for element in root.iter() if _tag(element) == "style" for rule in self._rules(element)
        ]
        self.rules.sort(key=lambda rule: rule[0])
        self.paths: list[DrawnPath] = []
        matrix, self.box = self._viewport(root)
        self._walk(root, matrix, INITIAL, 0)

    @property
    def fine(self) -> float:
        """A tolerance that is fine for this drawing, by the points of its paths."""
        contours = [part for each in self.paths for part in each.outline(each.matrix, math.inf).contours]
        extent = float(np.ptp(np.concatenate(contours), axis=0).max()) if contours else 0.0
        return FINE * extent or 1.0

    def shown(self, tolerance: float) -> list[tuple[str, Any]]:
        """Return names and regions of the paths that show anything."""
        regions = [(each.name, each.region(tolerance)) for each in self.paths]
        if self.box is not None:
            regions = [(name, shapely.intersection(region, self.box)) for name, region in regions]
        return [(name, region) for name, region in regions if region.area > 0.0]

    def _viewport(self, root: Element) -> tuple[Transform, Any]:
        """Return the matrix of the drawing, and the box beyond which nothing is seen; None without one."""
        numbers = [float(x) for x in re.findall(_DECIMAL, root.get("viewBox", ""))]
        sides = [root.get(side, "100%") for side in ("width", "height")]
        given = None if any("%" in side for side in sides) else [_length(side, self.name) for side in sides]
        if len(numbers) != 4:
            return Transform(), None if given is None else shapely.box(0.0, 0.0, *given)
        x, y, width, height = numbers
        matrix = Transform()
        if given is not None and root.get("preserveAspectRatio", "").strip() == "none":
            matrix = matrix.scale(given[0] / width, given[1] / height)
        left, top = matrix.transformPoint((x, y))
        right, bottom = matrix.transformPoint((x + width, y + height))
        return matrix, shapely.box(left, top, right, bottom)

    def _walk(self, element: Element, matrix: Transform, inherited: Mapping[str, str], depth: int) -> None:
        """Add the paths of an element and of those in it."""
        tag, name = _tag(element), self._name(element)
        own = self._own_properties(element, name)
        if own.get("display") == "none" or own.get("opacity") == "0":
            return
        if tag in REFUSED and not (tag == "foreignObject" and element.get("requiredExtensions")):
            raise UsageError(f"{name} {REFUSED[tag]}.")
        if tag not in (*GROUPS, *SHAPES, "use"):
            return
        for hiding in HIDING:
            if own.get(hiding, "none") != "none":
                raise UsageError(f"{name} has a {hiding}. Apply it in the program that drew it.")
        if depth > DEEPEST or len(self.paths) >= MOST_PATHS:
            raise UsageError(
                f"{name} is one of too many: {MOST_PATHS} paths, {DEEPEST} within each other. Simplify it."
            )
        if tag == "svg" and depth:
            raise UsageError(f"{name} is a drawing within the drawing. Make it a group.")
        properties = {key: own.get(key, value) for key, value in inherited.items()}
        matrix = matrix.transform(_matrix(own.get("transform", ""), name))
        if tag == "use":
            self._use(element, name, matrix, properties, depth)
        elif tag in SHAPES:
            data = _path_data(element, tag, name)
            if data and properties["visibility"] == "visible":
                self.paths.append(DrawnPath(name, data, matrix, properties))
        else:
            for child in element:
                self._walk(child, matrix, properties, depth + 1)

    def _use(
        self, element: Element, name: str, matrix: Transform, properties: Mapping[str, str], depth: int
    ) -> None:
        """Add the paths of an element that another one repeats."""
        href = next((href for key, href in element.attrib.items() if key.endswith("href")), "")
        used = self.ids.get(href.removeprefix("#")) if href.startswith("#") else None
        if used is None:
            raise UsageError(
                f"{name} uses {shortened(href)}, which is not in the file. Export the drawing again."
            )
        x, y = (_length(element.get(side, "0"), name) for side in "xy")
        matrix = matrix.translate(x, y)
        if _tag(used) != "symbol":
            self._walk(used, matrix, properties, depth + 1)
            return
        if used.get("viewBox"):
            raise UsageError(f"{name} uses a symbol with a viewBox. Make it a group.")
        for child in used:
            self._walk(child, matrix, properties, depth + 1)

    def _name(self, element: Element) -> str:
        identity = element.get("id")
        where = (
            f"{_tag(element)} {shortened(identity)}" if identity else f"{_tag(element)} {len(self.paths) + 1}"
        )
        return f"{self.name}: {where}"

    def _rules(self, element: Element) -> Iterator[tuple[int, str, str, dict[str, str]]]:
        """Yield the rules of a style sheet: their rank, tag, mark and name, and what they set."""
        text = re.sub(r"/\*.*?\*/", "", element.text or "", flags=re.DOTALL)
        for selectors, body in _RULE.findall(text):
            for selector in selectors.split(","):
                match = _SELECTOR.fullmatch(selector.strip())
                if match is None or not selector.strip():
                    fact = f"its style sheet has {shortened(' '.join(selector.split()))}"
                    rule = "names, .classes and #ids are read"
                    raise UsageError(f"{self.name}: {fact}; {rule}. Export it with styles as attributes.")
                tag, mark, named = (part or "" for part in match.groups())
                rank = 2 * {"": 0, ".": 1, "#": 2}[mark] + (tag not in ("", "*"))
                yield rank, tag, mark + named, _declarations(body)

    def _own_properties(self, element: Element, name: str) -> dict[str, str]:
        """Return the properties that an element sets: by attributes, style sheets, and its own style."""
        known = (*INITIAL, *OWN)
        found = {key: element.get(key, "").strip() for key in known if element.get(key)}
        marks = {"", f"#{element.get('id')}", *(f".{part}" for part in element.get("class", "").split())}
        for _, tag, mark, values in self.rules:
            if tag in ("", "*", _tag(element)) and mark in marks:
                found |= values
        styled = _declarations(element.get("style", ""))
        if "transform" in styled:
            raise UsageError(f"{name} has a transform in its style. Write it as an attribute.")
        found |= styled
        return {key: value for key, value in found.items() if key in known and value != "inherit"}


def _tag(element: Element) -> str:
    """Return the name of an element of SVG; with its namespace for one of another."""
    tag = element.tag if isinstance(element.tag, str) else ""
    return tag.removeprefix("{http://www.w3.org/2000/svg}")


def _declarations(text: str) -> dict[str, str]:
    """Return the properties of `fill: red; stroke: none`."""
    pairs = (part.partition(":") for part in text.split(";"))
    return {key.strip(): value.replace("!important", "").strip() for key, _, value in pairs if value}


def _length(text: str, name: str) -> float:
    """Return a length in units of the drawing. Raises UsageError for one in others."""
    match = _LENGTH.fullmatch(text)
    if match is None or match[2] not in UNITS:
        raise UsageError(f"{name} has a length of {shortened(text)}. Write a number, or one with px or mm.")
    return float(match[1]) * UNITS[match[2]]


def _matrix(text: str, name: str) -> Transform:
    """Return the matrix of `translate(10, 0) rotate(30)`."""
    matrix, at = Transform(), 0
    while at < len(text):
        match = _FUNCTION.match(text, at)
        values = [float(x) for x in re.findall(_DECIMAL, match[2])] if match else []
        step = _step(match[1], values) if match else None
        if match is None or step is None:
            raise UsageError(
                f"{name} has a transform {shortened(text)} that is not valid. Export the drawing again."
            )
        matrix, at = matrix.transform(step), match.end()
    return matrix


def _step(function: str, values: list[float]) -> Transform | None:
    """Return the matrix of one function of a transform; None for one that is not valid."""
    plain, degree = Transform(), math.radians(1.0)
    match function, values:
        case "matrix", [_, _, _, _, _, _]:
            return Transform(*values)
        case "translate", [x, *rest] if len(rest) < 2:
            return plain.translate(x, *rest)
        case "scale", [x, *rest] if len(rest) < 2:
            return plain.scale(x, *(rest or [x]))
        case "rotate", [angle]:
            return plain.rotate(degree * angle)
        case "rotate", [angle, x, y]:
            return plain.translate(x, y).rotate(degree * angle).translate(-x, -y)
        case "skewX", [angle]:
            return plain.skew(degree * angle, 0.0)
        case "skewY", [angle]:
            return plain.skew(0.0, degree * angle)
    return None


def _path_data(element: Element, tag: str, name: str) -> str:
    """Return a shape as path data; an empty text for one that shows nothing."""
    if tag == "path":
        return element.get("d", "").strip()
    if tag in ("polyline", "polygon"):
        points = element.get("points", "").strip()
        return f"M{points}{'Z' * (tag == 'polygon')}" if points else ""

    def get(key: str, default: str = "0") -> float:
        return _length(element.get(key, default), name)

    if tag == "line":
        return f"M{get('x1')!r},{get('y1')!r} {get('x2')!r},{get('y2')!r}"
    if tag == "rect":
        x, y, width, height = get("x"), get("y"), get("width"), get("height")
        one = element.get("rx", element.get("ry", "0"))  # stands for the other, where that is left out
        rx, ry = min(get("rx", one), 0.5 * width), min(get("ry", one), 0.5 * height)
    else:
        rx, ry = (get("r"), get("r")) if tag == "circle" else (get("rx"), get("ry"))
        x, y, width, height = get("cx") - rx, get("cy") - ry, 2.0 * rx, 2.0 * ry
    if width <= 0.0 or height <= 0.0:
        return ""
    if not rx or not ry:
        return f"M{x!r},{y!r}h{width!r}v{height!r}h{-width!r}Z"
    corner = f"a{rx!r},{ry!r} 0 0 1 "
    across, down = width - 2.0 * rx, height - 2.0 * ry
    return (
        f"M{x + rx!r},{y!r}h{across!r}{corner}{rx!r},{ry!r}v{down!r}{corner}{-rx!r},{ry!r}"
        f"h{-across!r}{corner}{-rx!r},{-ry!r}v{-down!r}{corner}{rx!r},{-ry!r}Z"
    )
