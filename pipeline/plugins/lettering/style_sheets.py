"""Style sheets of drawings: the properties that they give elements on a light screen.

The cascade is that of CSS Cascading and Inheritance Level 5, and conditions are those of Media Queries
Level 4.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from xml.etree.ElementTree import Element

from flowsculpt import UsageError
from flowsculpt.api import quote

Priority = tuple[bool, float, int, int]
"""Of a declaration: whether it is important, its layer, the specificity of its selector, and its place."""

STYLE_ATTRIBUTE = (math.inf, 9, 0)
"""Layer, specificity and place of an element's own style."""

IGNORED = ("font-face", "charset", "namespace", "page", "keyframes", "-webkit-keyframes", "property")
"""Rules that change no outline at rest."""

DEEPEST, LONGEST = 16, 1000
"""Conditions within each other, and characters of one."""

FEATURES = {
    "prefers-color-scheme": "light",
    "prefers-reduced-motion": "no-preference",
    "prefers-reduced-transparency": "no-preference",
    "prefers-contrast": "no-preference",
    "forced-colors": "none",
    "inverted-colors": "none",
    "monochrome": "0",
    "color": "8",
    "color-gamut": "srgb",
    "hover": "hover",
    "any-hover": "hover",
    "pointer": "fine",
    "any-pointer": "fine",
}
"""What a light screen is, by the names of Media Queries Level 5."""

_LENGTHS = {"px": 1.0, "em": 16.0, "rem": 16.0, "pt": 96 / 72, "mm": 96 / 25.4, "cm": 96 / 2.54, "in": 96.0}
_TOKEN = re.compile(r"""[{};]|"[^"]*+"?|'[^']*+'?|url\([^)]*+\)?""", re.IGNORECASE)
_AT_RULE = re.compile(r"\s*+@")
_SELECTOR = re.compile(r"([\w-]++|\*)?(?:([.#])([\w-]++))?")
_OF_MEDIUM = re.compile(r"\s*+(?:only\s++)?([a-z-]++)\s++and\b")
_INNERMOST = re.compile(r"\(([^()]*+)\)")
_SIZE = re.compile(r"(?:(min|max)-)?(width|height) *: *(\d++(?:\.\d++)?|\.\d++)([a-z]++)")
_RANGE = re.compile(r"(width|height) *([<>]=?|=) *(\d++(?:\.\d++)?|\.\d++)([a-z]++)")


class StyleSheets:
    """The rules of a drawing by their selectors.

    name        of the drawing, for messages
    attributes  the properties that count as attributes of elements too
    others      the properties that count only in style sheets
    size        width and height of the drawing, px; None where it does not say them
    """

    def __init__(
        self, name: str, attributes: frozenset[str], others: frozenset[str], size: tuple[float, float] | None
    ) -> None:
        self.name, self._attributes, self._known, self._size = name, attributes, attributes | others, size
        self._rules: dict[tuple[str, str], dict[str, tuple[Priority, str]]] = {}
        self._layers: dict[str, int] = {}
        self._count = 0

    def add(self, element: Element) -> None:
        """Add the rules of a `style` element. Raises UsageError for those that cannot be read."""
        kind, media = element.get("type", ""), element.get("media", "")
        if kind.strip().lower() in ("", "text/css") and self._applies(media, f"media={media}"):
            first, *parts = "".join(element.itertext()).split("/*")
            self._read(" ".join([first, *(part.partition("*/")[2] for part in parts)]), math.inf, 0)

    def properties(self, element: Element, tag: str) -> dict[str, str]:
        """Return the properties of an element: of its attributes, of rules, and of its own style."""
        found: dict[str, tuple[Priority, str]] = {}
        for name in self._attributes.intersection(element.keys()):
            found[name] = (False, -1.0, 0, 0), element.get(name, "").strip().lower()
        if self._rules:
            marks = {"", f"#{element.get('id')}", *(f".{part}" for part in element.get("class", "").split())}
            for selector in ((name, mark) for name in ("", tag) for mark in marks):
                _merge(found, self._rules.get(selector, {}))
        if style := element.get("style"):
            _merge(found, self._declarations(style, *STYLE_ATTRIBUTE))
        return {name: value for name, (_, value) in found.items() if value}

    def _declarations(
        self, text: str, layer: float, rank: int, place: int
    ) -> dict[str, tuple[Priority, str]]:
        """Return the known properties of `fill: red; stroke: none` with their priority."""
        found: dict[str, tuple[Priority, str]] = {}
        for part in text.split(";"):
            name, _, value = (piece.strip().lower() for piece in part.partition(":"))
            value, important = re.subn(r"! *important$", "", value, count=1)
            if name in self._known and value:
                order = -layer if important and rank < STYLE_ATTRIBUTE[1] else layer  # layers in reverse
                _merge(found, {name: ((bool(important), order, rank, place), value.strip())})
        return found

    def _read(self, text: str, layer: float, depth: int) -> None:
        """Add the rules of a style sheet or of a block in it."""
        for head, body in _statements(text):
            if not head.startswith("@"):
                self._rule(head, body, layer)
                continue
            kind, _, condition = re.sub(r"(?<=\w)(?=\()", " ", head[1:], count=1).partition(" ")
            kind, condition = kind.lower(), condition.strip()
            if kind in IGNORED:
                continue
            if depth > DEEPEST:
                raise self._unread(head, "it is within too many others")
            if kind == "media":
                if self._applies(condition, head):
                    self._read(body, layer, depth + 1)
            elif kind == "layer" and layer == math.inf and "." not in condition:
                names = [name.strip() for name in condition.split(",")] if not body else [condition]
                for name in names:
                    self._layers.setdefault(name or f" {self._count}", len(self._layers))
                if body:
                    self._read(body, self._layers[names[0] or f" {self._count}"], depth + 1)
            else:
                raise self._unread(head, "whether its rules count is not known")

    def _rule(self, selectors: str, body: str, layer: float) -> None:
        if "{" in body:
            raise self._unread(f"{selectors} {{{body}}}", "rules within a rule are not read")
        self._count += 1
        if not self._declarations(body, layer, 0, 0):
            return
        for selector in selectors.split(","):
            match = _SELECTOR.fullmatch(selector.strip())
            if match is None or not selector.strip():
                raise self._unread(" ".join(selector.split()), "names, .classes and #ids are read")
            tag, mark, named = (part or "" for part in match.groups())
            tag = tag.replace("*", "")
            rank = 2 * {"": 0, ".": 1, "#": 2}[mark] + bool(tag)
            declared = self._declarations(body, layer, rank, self._count)
            _merge(self._rules.setdefault((tag, mark + named), {}), declared)

    def _unread(self, fact: str, rule: str) -> UsageError:
        found = f"{self.name}: its style sheet has {quote(fact)}; {rule}"
        return UsageError(f"{found}. Export it with styles as attributes.")

    def _applies(self, queries: str, head: str) -> bool:
        """Tell whether a list of media queries is true of a light screen. Raises UsageError where unknown."""
        try:
            if len(queries) > LONGEST:
                raise ValueError("it is too long")
            return not queries.strip() or any(self._is_true(query) for query in queries.lower().split(","))
        except ValueError as error:
            raise self._unread(head, str(error)) from None

    def _is_true(self, query: str) -> bool:
        if (medium := _OF_MEDIUM.match(query)) and medium[1] not in ("all", "screen", "not"):
            return False  # whatever else it asks
        while match := _INNERMOST.search(query):
            inner = match[1].strip()
            is_true = self._feature(inner) if not re.match(r"[01]|not\b", inner) else _combined(inner)
            query = f"{query[: match.start()]} {is_true:d} {query[match.end() :]}"
        return _combined(query)

    def _feature(self, feature: str) -> bool:
        """Tell whether `min-width: 20px` is true. Raises ValueError where it is not known."""
        name, colon, value = (part.strip() for part in feature.partition(":"))
        if name in FEATURES:
            return FEATURES[name] == value if colon else FEATURES[name] not in ("none", "no-preference", "0")
        sized, ranged = _SIZE.fullmatch(feature), _RANGE.fullmatch(feature)
        if sized:
            limit, side, number, unit = sized.groups()
            relation = {"min": ">=", "max": "<=", None: "="}[limit]
        elif ranged:
            side, relation, number, unit = ranged.groups()
        else:
            raise ValueError("this is not known of a light screen")
        if self._size is None or unit not in _LENGTHS:
            raise ValueError("the drawing does not say its width and height in px")
        bound, own = float(number) * _LENGTHS[unit], self._size[side == "height"]
        return ("<" if own < bound else ">" if own > bound else "=") in relation


def _combined(query: str) -> bool:
    """Tell whether a query is true whose conditions are 0 and 1: `not print and 1`."""
    first, *rest = query.split() or ["all"]
    words = rest if first in ("not", "only") else [first, *rest]
    operators = set(words[1::2])
    is_mixed = len(operators) > 1 or not operators <= {"and", "or"} or len(words) % 2 == 0
    if is_mixed or (first == "not" and words[0] in "01" and len(words) > 1) or set("()") & set(query):
        raise ValueError("this is not a media query")
    true = [word in ("1", "all", "screen") for word in words[::2]]
    return (any(true) if "or" in operators else all(true)) != (first == "not")


def _merge(found: dict[str, tuple[Priority, str]], more: Mapping[str, tuple[Priority, str]]) -> None:
    """Put declarations into others where they have at least the same priority."""
    for name, (priority, value) in more.items():
        if name not in found or priority >= found[name][0]:
            found[name] = priority, value


def _statements(text: str) -> Iterator[tuple[str, str]]:
    """Yield what is before each block of a style sheet, and the block; an empty one for `@import …;`."""
    start, opened, depth = 0, 0, 0
    ends_early = {0: _AT_RULE.match(text) is not None}
    for token in _TOKEN.finditer(text):
        if start not in ends_early:
            ends_early = {start: _AT_RULE.match(text, start) is not None}
        match token[0]:
            case "{":
                opened = opened if depth else token.start()
                depth += 1
            case "}" if depth:
                depth -= 1
                if not depth:
                    yield text[start:opened].strip(), text[opened + 1 : token.start()]
                    start = token.end()
            case ";" if not depth and ends_early[start]:
                yield text[start : token.start()].strip(), ""
                start = token.end()
    if depth:  # the end of the sheet ends its blocks
        yield text[start:opened].strip(), text[opened + 1 :]
