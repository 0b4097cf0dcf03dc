"""Outlines of SVG drawings: what fills and strokes cover, as a browser shows it.

A browser in English, on a light screen. Colours do not count. What is more than outlines, such as text,
pictures, masks and dashes, is refused.
"""

from __future__ import annotations

import gzip
import io
import math
import re
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, ParseError, TreeBuilder, XMLParser, fromstring

import numpy as np
import shapely
from fontTools.misc.transform import Transform
from fontTools.pens.boundsPen import BoundsPen
from fontTools.pens.transformPen import TransformPen
from fontTools.svgLib.path import parse_path
from shapely import affinity

from flowsculpt import UsageError
from flowsculpt.api import quote
from flowsculpt.api.files import InputFile
from flowsculpt.pipeline.plugins.lettering.outlines import OutlineShape, PolylinePen, filled
from flowsculpt.pipeline.plugins.lettering.strokes import Stroke, stroked
from flowsculpt.pipeline.plugins.lettering.style_sheets import StyleSheets
from flowsculpt.pipeline.plugins.lettering.svg_values import DECIMAL, LARGEST, TURNING, Box, length, matrix_of

MOST_BYTES = 1 << 26
MOST_PATHS = 5000
DEEPEST = 64
"""Groups and uses within each other."""

MOST_VISITS = 100_000
"""Elements that are shown; those that `use` repeats count each time."""

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

HIDING = ("clip-path", "mask", "marker", "marker-start", "marker-mid", "marker-end")
"""Properties that change what an outline shows; they are refused."""

OWN = ("display", "opacity", "transform", "transform-origin", "transform-box", *HIDING)
"""Properties that elements do not inherit."""

ATTRIBUTES = frozenset((*INITIAL, *OWN)) - {"marker"}
"""Properties that may be attributes."""

INHERITED = ("inherit", "unset", "revert", "revert-layer")
"""Values that mean what an element inherits."""

GEOMETRY = frozenset(("d", "x", "y", "cx", "cy", "r", "rx", "ry", "width", "height"))
"""Attributes that style sheets may set too, which is refused."""

_NO_DATA = re.compile(r"[^MmZzLlHhVvCcSsQqTtAa0-9eE.,+\s-]")
_ZEROS, _BARE_POINT = re.compile(r"(?<![\d.eE])([-+]?)0+(?=\d)"), re.compile(r"(?<=\d)\.(?=[eE])")
"""What the parser of path data takes for two numbers: `007` and `6.e3`."""


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
    extent = max(right - left, high - low)
    if extent * LARGEST < 1.0:
        raise UsageError(f"{path.name} shows nothing larger than {extent:.3g}. Scale it up.")
    scale = size / extent
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
        self.draw(pen)
        return pen

    def require_near(self, contours: Sequence[np.ndarray]) -> None:
        """Raise UsageError where contours have numbers that are not finite, or too large."""
        if not all(np.abs(points).max(initial=0.0) <= LARGEST for points in contours):
            raise UsageError(f"{self.name} reaches beyond {LARGEST:g} units. Scale it down.")

    def draw(self, pen: Any) -> None:
        """Draw the path, in its own coordinates, with a pen of fontTools. Raises UsageError as `region`."""
        try:
            if _NO_DATA.search(self.data):
                raise ValueError("letters that mean nothing")
            parse_path(_with_plain_numbers(self.data), pen)
        except Exception as error:  # the parser raises whatever it stumbles over
            fact = f"its path data {quote(self.data)} is not valid"
            raise UsageError(f"{self.name}: {fact}. Export the drawing again.") from error

    def _fill(self, tolerance: float) -> Iterator[Any]:
        rule = self.properties["fill-rule"]
        if self._is_painted("fill"):
            contours = self.outline(self.matrix, tolerance).contours
            yield filled(contours, "evenodd" if rule == "evenodd" else "nonzero")

    def _stroke(self, tolerance: float) -> Iterator[Any]:
        given = self.properties
        width = length(given["stroke-width"], self.name)
        if width < 0.0:
            fact = f"a stroke-width of {given['stroke-width']}, below 0"
            raise UsageError(f"{self.name} has {fact}. Write 0 for none.")
        if not self._is_painted("stroke") or not width:
            return
        if self._has_dashes() or given["vector-effect"] != "none":
            raise UsageError(f"{self.name} has a stroke with dashes or of fixed width. Convert it to a path.")
        a, b, c, d, *_ = self.matrix
        pen = self.outline(Transform(), tolerance / max((a * a + b * b + c * c + d * d) ** 0.5, 1e-300))
        self.require_near(pen.contours)
        limit = length(given["stroke-miterlimit"], self.name)
        stroke = Stroke(0.5 * width, given["stroke-linecap"], given["stroke-linejoin"], limit)
        covered = stroked(pen, stroke)
        yield affinity.affine_transform(covered, [a, c, b, d, self.matrix.dx, self.matrix.dy])

    def _is_painted(self, paint: str) -> bool:
        return not (is_clear(self.properties[paint]) or is_zero(self.properties[f"{paint}-opacity"]))

    def _has_dashes(self) -> bool:
        """Tell whether the stroke is cut: dashes that are all 0 are none, and so are those below 0."""
        text = self.properties["stroke-dasharray"]
        dashes = [length(part, self.name) for part in re.split(r"[\s,]+", text) if part and text != "none"]
        return any(dashes) and min(dashes) >= 0.0


@lru_cache(maxsize=256)
def is_zero(opacity: str) -> bool:
    """Tell whether an opacity, as `0.5` or `50%`, is 0."""
    match = re.fullmatch(rf"({DECIMAL})\s*%?", opacity)
    return match is not None and float(match[1]) <= 0.0


@lru_cache(maxsize=256)
def is_clear(colour: str) -> bool:
    """Tell whether a colour is not seen: `none`, `transparent`, or with an alpha of 0."""
    parts = re.split(r"[\s,/]+", colour.partition("(")[2].rstrip(") "))
    has_no_alpha = colour.startswith(("rgb", "hsl")) and len(parts) == 4 and is_zero(parts[3])
    return has_no_alpha or re.fullmatch(r"none|transparent|#...0|#.{6}00", colour) is not None


def _with_plain_numbers(data: str) -> str:
    """Return path data with numbers as its parser takes them; flags of arcs may be written without spaces."""
    plain = _BARE_POINT.sub("", data)
    return plain if "a" in plain or "A" in plain else _ZEROS.sub(r"\1", plain)


class SvgDrawing:
    """The paths of a drawing, and the box that they are seen in, in units of the drawing.

    Raises UsageError as `drawn_shapes`.
    """

    def __init__(self, path: Path) -> None:
        self.name = path.name
        root = _root(path)
        elements = list(root.iter())
        self.ids = {element.get("id"): element for element in reversed(elements) if element.get("id")}
        self._visits = 0
        self.paths: list[DrawnPath] = []
        matrix, self.box, size = self._viewport(root)
        self._sheets = StyleSheets(self.name, ATTRIBUTES, GEOMETRY | {*TURNING, "marker"}, size)
        for element in elements:
            if _tag(element) == "style":
                self._sheets.add(element)
        turned = self._turned_drawing(root)
        if self.box is not None and turned != Transform():
            self.box = affinity.affine_transform(self.box, [*turned[0:4:2], *turned[1:4:2], *turned[4:]])
        self._walk(root, turned.transform(matrix), INITIAL, 0)

    @property
    def fine(self) -> float:
        """A tolerance that is fine for this drawing, by the points of its paths."""
        outlines = [each.outline(each.matrix, math.inf).contours for each in self.paths]
        contours = [part for outline in outlines for part in outline]
        extent = float(np.ptp(np.concatenate(contours), axis=0).max()) if contours else 0.0
        if not extent <= 0.5 * LARGEST:
            for each, outline in zip(self.paths, outlines, strict=True):
                each.require_near(outline)
        return FINE * extent or 1.0

    def shown(self, tolerance: float) -> list[tuple[str, Any]]:
        """Return names and regions of the paths that show anything."""
        regions = [(each.name, each.region(tolerance)) for each in self.paths]
        if self.box is not None:
            regions = [(name, shapely.intersection(region, self.box)) for name, region in regions]
        return [(name, region) for name, region in regions if region.area > 0.0]

    def _viewport(self, root: Element) -> tuple[Transform, Any, tuple[float, float] | None]:
        """Return the matrix of the drawing, the box beyond which nothing is seen, and its size; or None."""
        text, fit = root.get("viewBox", ""), root.get("preserveAspectRatio", "").strip()
        numbers = [float(x) for x in re.findall(DECIMAL, text)]
        sides = [root.get(side, "100%") for side in ("width", "height")]
        given = None if any("%" in side for side in sides) else [length(side, self.name) for side in sides]
        size = None if given is None else (given[0], given[1])
        self._frame: Box | None = None if size is None else (0.0, 0.0, *size)
        if len(numbers) != 4:
            return Transform(), None if given is None else shapely.box(0.0, 0.0, *given), size
        x, y, width, height = numbers
        if not (min(width, height) > 0.0 and max(map(abs, numbers)) <= LARGEST):
            raise UsageError(
                f"{self.name} has a viewBox of {quote(text)}. Write sides above 0 and up to 1e12."
            )
        if size and "slice" in fit and not math.isclose(size[0] * height, size[1] * width, rel_tol=1e-3):
            raise UsageError(f"{self.name} is cut off by 'slice' in preserveAspectRatio. Remove it.")
        matrix = Transform()
        if given is not None and fit == "none":
            matrix = matrix.scale(given[0] / width, given[1] / height)
        self._frame = 0.0, 0.0, width, height
        left, top = matrix.transformPoint((x, y))
        right, bottom = matrix.transformPoint((x + width, y + height))
        return matrix, shapely.box(left, top, right, bottom), size

    def _turned_drawing(self, root: Element) -> Transform:
        """Return the matrix of what transforms the whole drawing, about the middle of its box."""
        own, box = self._own_properties(root), None
        if self.box is not None:
            left, top, right, bottom = self.box.bounds
            box = left, top, right - left, bottom - top
        return matrix_of(own, f"{self.name}: svg", box, "50% 50%")

    def _walk(self, element: Element, matrix: Transform, inherited: Mapping[str, str], depth: int) -> None:
        """Add the paths of an element and of those in it."""
        tag, name = _tag(element), self._name(element)
        self._visits += 1
        if self._visits > MOST_VISITS:
            raise UsageError(
                f"{self.name} shows over {MOST_VISITS} elements, repeated ones too. Simplify it."
            )
        own = self._own_properties(element) if _is_for_readers(element) else {"display": "none"}
        if own.get("display") == "none" or is_zero(own.get("opacity", "1")):
            return
        if tag in REFUSED:
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
        if tag not in GROUPS and (styled := sorted(GEOMETRY & own.keys())):
            raise UsageError(f"{name} has {styled[0]} in its style. Write it as an attribute.")
        properties = {key: own.get(key, value) for key, value in inherited.items()}
        for paint in ("fill", "stroke"):
            properties[paint] = self._paint(properties[paint])
        if depth:
            box = self._reference_box(element, own, name, properties, depth)
            matrix = matrix.transform(matrix_of(own, name, box, "0 0"))
        self._add(element, name, matrix, properties, depth)

    def _add(
        self, element: Element, name: str, matrix: Transform, properties: Mapping[str, str], depth: int
    ) -> None:
        """Add the paths of an element whose place and properties are known."""
        tag = _tag(element)
        if tag == "use":
            self._use(element, name, matrix, properties, depth)
        elif tag in SHAPES:
            data = _path_data(element, tag, name)
            if data and properties["visibility"] not in ("hidden", "collapse"):
                self.paths.append(DrawnPath(name, data, matrix, properties))
        else:
            parts = [part for part in element if _is_for_readers(part)][: 1 if tag == "switch" else None]
            for part in parts:
                self._walk(part, matrix, properties, depth + 1)

    def _reference_box(
        self, element: Element, own: Mapping[str, str], name: str, properties: Mapping[str, str], depth: int
    ) -> Box | None:
        """Return the box that `transform-origin` and percentages of an element are of."""
        kind = own.get("transform-box", "view-box")
        if kind == "view-box" or not {"transform", *TURNING} & own.keys():
            return self._frame
        if kind not in ("fill-box", "content-box"):
            raise UsageError(f"{name} has a transform-box of {quote(kind)}. Write view-box or fill-box.")
        before, self.paths = self.paths, []
        try:
            self._add(element, name, Transform(), properties, depth)
            pens = [(BoundsPen(None), path) for path in self.paths]
            for pen, path in pens:
                path.draw(TransformPen(pen, path.matrix))
        finally:
            self.paths = before
        bounds = np.array([pen.bounds for pen, _ in pens if pen.bounds])
        if not len(bounds):
            return None
        (left, top), (right, bottom) = bounds[:, :2].min(axis=0).tolist(), bounds[:, 2:].max(axis=0).tolist()
        return left, top, right - left, bottom - top

    def _paint(self, colour: str) -> str:
        """Return a colour; in place of a gradient that is not in the file, the one that it names after it."""
        match = re.match(r"url\(\s*+['\"]?#([^)'\"]*+)['\"]?\s*+\)", colour)
        if match is None or any(match[1] == str(known).lower() for known in self.ids):
            return colour
        return colour[match.end() :].strip() or "none"

    def _use(
        self, element: Element, name: str, matrix: Transform, properties: Mapping[str, str], depth: int
    ) -> None:
        """Add the paths of an element that another one repeats."""
        href = element.get("href", element.get("{http://www.w3.org/1999/xlink}href", ""))
        used = self.ids.get(href.removeprefix("#")) if href.startswith("#") else None
        if used is None:
            raise UsageError(
                f"{name} uses {quote(href)}, which is not in the file. Export the drawing again."
            )
        x, y = (length(element.get(side, "0"), name) for side in "xy")
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
        where = f"{_tag(element)} {quote(identity)}" if identity else f"{_tag(element)} {len(self.paths) + 1}"
        return f"{self.name}: {where}"

    def _own_properties(self, element: Element) -> dict[str, str]:
        """Return the properties that an element sets; those that it inherits are left out."""
        found = self._sheets.properties(element, _tag(element))
        given = {key: INITIAL.get(key, "") if value == "initial" else value for key, value in found.items()}
        return {key: value for key, value in given.items() if value and value not in INHERITED}


def _root(path: Path) -> Element:
    """Return the root of a drawing, which gzip may have compressed. Raises UsageError where it is not SVG."""
    content = InputFile(path, MOST_BYTES).content()
    try:
        if content.startswith(b"\x1f\x8b"):
            with gzip.GzipFile(fileobj=io.BytesIO(content)) as file:
                content = file.read(MOST_BYTES + 1)
            if len(content) > MOST_BYTES:
                raise ValueError(f"compressed by gzip, it has over {MOST_BYTES >> 20} MiB")
        root = _parsed(content)
    except (ParseError, ValueError, LookupError, OSError, EOFError, zlib.error) as error:
        raise UsageError(f"{path.name} is not SVG: {error}. Export it again.") from None
    if _tag(root) != "svg":
        raise UsageError(f"{path.name} is not SVG: it begins with {quote(root.tag)}. Export it again.")
    return root


def _parsed(content: bytes) -> Element:
    """Return the root of XML. Raises ParseError, ValueError or LookupError."""
    try:
        return fromstring(content, XMLParser(target=_TreeBuilder()))
    except ValueError:  # expat knows UTF-8, UTF-16 and encodings of single bytes
        named = re.match(rb"""<\?xml[^>]*?encoding=["']([\w.-]+)""", content[:200])
        if named is None:
            raise
        return fromstring(content.decode(named[1].decode()), XMLParser(target=_TreeBuilder()))


class _TreeBuilder(TreeBuilder):
    def pi(self, target: str, text: str | None = None) -> Any:
        if target == "xml-stylesheet":
            raise ValueError("its style sheet is another file; copy it into a style element")
        return super().pi(target, text)


def _is_for_readers(element: Element) -> bool:
    """Tell whether an element is shown to readers of English by programs without extensions."""
    languages = element.get("systemLanguage")
    english = languages is None or any(
        language.strip().lower().partition("-")[0] == "en" for language in languages.split(",")
    )
    return english and element.get("requiredExtensions") is None


def _tag(element: Element) -> str:
    """Return the name of an element of SVG; with its namespace for one of another."""
    tag = element.tag if isinstance(element.tag, str) else ""
    return tag.removeprefix("{http://www.w3.org/2000/svg}")


def _path_data(element: Element, tag: str, name: str) -> str:
    """Return a shape as path data; an empty text for one that shows nothing."""
    if tag == "path":
        return element.get("d", "").strip()
    if tag in ("polyline", "polygon"):
        points = element.get("points", "").strip()
        return f"M{points}{'Z' * (tag == 'polygon')}" if points else ""

    def get(key: str, default: str = "0") -> float:
        return length(element.get(key, default), name)

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
