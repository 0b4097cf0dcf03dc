"""Mistakes within braces and brackets that YAML reads as something else, so that no parser reports them.

`{azimuth:20}` is a name `azimuth:20` without a value, and `{radius: 0,5}` is a radius of 0 and a name 5. Each
is reported once, and read as it was meant, so that nothing else is reported about it.
"""

from __future__ import annotations

import re
from collections import deque
from itertools import islice
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from pipeline.shot.yaml.syntax_errors import HEX_COLOUR, quoted

Pair = tuple[Node, Node]
Mistake = tuple[Node, str]
"""The node at which a mistake stands, and the message."""

_NUMBER = re.compile(r"[-+]?\d+")
_COMMENT = re.compile(r"\s*:\s+(#.*)$")

_MOST_PARTS = 30
"""Most parts into which commas are taken to have cut a formula."""


def meant_pairs(node: MappingNode) -> tuple[list[Pair], list[Mistake]]:
    """Return the entries of a mapping in braces as they were meant, and the mistakes in them."""
    pairs: list[Pair] = []
    mistakes: list[Mistake] = []
    given = deque(node.value)
    while given:
        key, value = given.popleft()
        if (text := _name_alone(key, value)) is not None:
            key, value = _split(key, value, text, mistakes)
        elif _is_plain(value) and _depth(value.value) > 0:
            parts = [name for name, empty in islice(given, _MOST_PARTS) if _is_empty(empty)]
            value = _rejoined(value, parts, mistakes, given)
        elif given and _is_decimal(value, *given[0]):
            value = _decimal(value, given.popleft()[0], mistakes)
        pairs.append((key, value))
    return pairs, mistakes


def meant_items(node: SequenceNode) -> tuple[list[Node], list[Mistake]]:
    """Return the items of a list in brackets as they were meant, and the mistakes in them."""
    items: list[Node] = []
    mistakes: list[Mistake] = []
    given = deque(node.value)
    while given:
        item = given.popleft()
        if _is_plain(item) and _depth(item.value) > 0:
            item = _rejoined(item, list(islice(given, _MOST_PARTS)), mistakes, given)
        items.append(item)
    return items, mistakes


LOST = "for # begins a comment in YAML"
"""Why a value that begins with # is empty."""


def lost_colour(key: Node, value: Node, lines: list[str]) -> str | None:
    """Return the colour that stands as a comment in place of a value; None if there is none."""
    if not _is_empty(value):
        return None
    comment = _COMMENT.match(lines[key.end_mark.line], key.end_mark.column)
    colour = HEX_COLOUR.match(comment[1]) if comment else None
    return colour[0] if colour else None


def plain(text: str, like: Node) -> ScalarNode:
    """Return the node of a plain value, at the place of another one."""
    node = YAML().compose(text)
    if not isinstance(node, ScalarNode):
        node = ScalarNode("tag:yaml.org,2002:str", text)
    node.start_mark, node.end_mark = like.start_mark, like.end_mark
    return node


def _is_plain(node: Node) -> bool:
    return isinstance(node, ScalarNode) and node.style is None


def _is_empty(node: Node) -> bool:
    return _is_plain(node) and node.value == ""


def _name_alone(key: Node, value: Node) -> str | None:
    """Return the text of an entry that has no value, if it holds a colon, or a name and a number."""
    if not (_is_plain(key) and _is_empty(value)):
        return None
    text = str(key.value)
    return text if re.fullmatch(r"[\w.]+:.*|[\w.]+ +[-+\d.\w]+", text) else None


def _split(key: Node, value: Node, text: str, mistakes: list[Mistake]) -> Pair:
    """Return name and value of `azimuth:20` or `azimuth 20`; `azimuth:` has no value."""
    name, rest = re.split(r":| +", text, maxsplit=1)
    if rest:
        fact = "a space is missing after the colon" if ":" in text else "a colon is missing"
        mistakes.append((key, f"{fact}. Write {name}: {rest}."))
        value = plain(rest, key)
    return plain(name, key), value


def _is_decimal(value: Node, key: Node, empty: Node) -> bool:
    """Tell whether a value and the next name are a number with a comma, such as 0,5."""
    return (
        _is_plain(value)
        and _is_plain(key)
        and _is_empty(empty)
        and bool(_NUMBER.fullmatch(value.value) and _NUMBER.fullmatch(key.value))
        and value.end_mark.line == key.start_mark.line
        and value.end_mark.column + 1 == key.start_mark.column
    )


def _decimal(value: Node, key: Node, mistakes: list[Mistake]) -> Node:
    number = f"{value.value}.{key.value}"
    fact = f"{value.value},{key.value} is two entries in YAML; decimals have a point"
    mistakes.append((value, f"{fact}. Write {number}."))
    return plain(number, value)


def _depth(text: str) -> int:
    return text.count("(") - text.count(")")


def _rejoined(item: Node, parts: list[Node], mistakes: list[Mistake], given: deque[Any]) -> Node:
    """Return the text that commas between round brackets have parted, or the item if they stay open.

    Its parts are removed from those that are still to be read, `given`.
    """
    text = str(item.value)
    for count, node in enumerate(parts, 1):
        if not _is_plain(node):
            break
        text = f"{text}, {node.value}"
        if _depth(text) == 0:
            for _ in range(count):
                given.popleft()
            return _whole(item, text, mistakes)
    return item


def _whole(item: Node, text: str, mistakes: list[Mistake]) -> Node:
    if not text.startswith(("(", "rgb")):  # lists and colours are reported as what they are
        fact = "a comma ends an entry within [ ] and { }"
        mistakes.append((item, f"{fact}. Put the formula in quotes: {quoted(text)}."))
    return ScalarNode("tag:yaml.org,2002:str", text, item.start_mark, item.end_mark, style="'")
