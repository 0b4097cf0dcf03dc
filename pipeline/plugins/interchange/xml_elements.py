"""XML of model files, parsed by expat.

Entities are refused: by them a few bytes become gigabytes, or name other files.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from typing import NoReturn
from xml.parsers import expat

from flowsculpt import MeshError

_DEEPEST = 500  # elements within elements


@dataclass(slots=True)
class Element:
    """An element of XML, and the line where it begins; names are without prefixes of namespaces."""

    name: str
    attributes: dict[str, str]
    line: int
    text: str = ""
    children: list[Element] = field(default_factory=list)

    def all(self, name: str) -> Iterator[Element]:
        """Yield the children of a name."""
        return (child for child in self.children if child.name == name)

    def first(self, *path: str) -> Element | None:
        """Return the first child of a name, its first child of the next name, and so on; else None."""
        element: Element | None = self
        for name in path:
            if element is None:
                return None
            element = next(element.all(name), None)
        return element


class _EnoughError(Exception):
    """Ends parsing where the rest does not matter."""


def parse_elements(content: bytes, until: str = "") -> Element:
    """Return the root element; what follows its child of the name `until` is not parsed.

    Raises MeshError for entities, ExpatError with its line for other faults.
    """
    stack = [Element("", {}, 0)]
    texts: list[list[str]] = [[]]

    def start(name: str, attributes: dict[str, str]) -> None:
        element = Element(local_name(name), attributes, parser.CurrentLineNumber)
        stack[-1].children.append(element)
        stack.append(element)
        texts.append([])

    def end(name: str) -> None:
        element = stack.pop()
        element.text = "".join(texts.pop())
        if len(stack) == 2 and element.name == until:
            raise _EnoughError

    parser = limited_parser(start, end)
    parser.CharacterDataHandler = lambda text: texts[-1].append(text)
    with suppress(_EnoughError):
        parser.Parse(content, True)
    return stack[0].children[0]


def limited_parser(
    start: Callable[[str, dict[str, str]], None], end: Callable[[str], None]
) -> expat.XMLParserType:
    """Return a parser that calls functions where elements start and end, and refuses entities."""
    depth = 0

    def opened(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > _DEEPEST:
            raise MeshError(f"line {parser.CurrentLineNumber}: elements are nested over {_DEEPEST} deep")
        start(name, attributes)

    def closed(name: str) -> None:
        nonlocal depth
        depth -= 1
        end(name)

    def refuse(name: str, *_: object) -> NoReturn:
        raise MeshError(
            f"line {parser.CurrentLineNumber}: it declares the entity {name[:40]!r}; entities are not read. "
            "Write out their text instead."
        )

    parser = expat.ParserCreate()
    parser.buffer_text = True
    parser.StartElementHandler, parser.EndElementHandler = opened, closed
    parser.EntityDeclHandler = refuse
    return parser


def local_name(name: str) -> str:
    """Return the name of an element or attribute without the prefix of its namespace."""
    return name.rpartition(":")[2]
