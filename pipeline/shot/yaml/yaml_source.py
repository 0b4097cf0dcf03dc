"""YAML text as plain values with their positions, values as text, and messages about text that is not YAML.

ruamel.yaml's node tree is walked directly: YAML 1.2 (`on` and `12:30` are text), every key with its line
and column, and every duplicate key reported instead of the first only.
"""

from __future__ import annotations

import json
import math
import re
import unicodedata
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode
from ruamel.yaml.reader import ReaderError
from ruamel.yaml.scanner import RoundTripScanner

from flowsculpt.pipeline.errors import ShotError, quote, shorten
from flowsculpt.pipeline.shot.yaml.named_files import MOST_BYTES, text_of

HEX_COLOUR = re.compile(r"#(?:[0-9a-fA-F]{3}){1,2}(?![0-9a-zA-Z])")
"""A colour as web pages have it. Outside of quotes YAML takes it as a comment."""

_LOST_COLOUR = re.compile(r"(?:[:,]\s+|[\[{]\s*)(#[0-9a-fA-F]{3,8})\b")

_UNSEEN = re.compile(r"[\u00a0\u00ad\u1680\u2000-\u200f\u2028-\u202f\u205f-\u2064\u3000\ufeff]")
"""Spaces of other programs and characters without width, which YAML takes for letters."""

_MOST_CHARACTERS = 1000
"""Characters of a line that are read: nobody writes more, and patterns take long on more."""

_REMEDIES = (
    ("cannot start any token", "no text begins with this character in YAML; put the text in quotes"),
    (
        "undefined alias",
        "* stands for a value marked & in YAML, and none is; quote text, and begin an item with -",
    ),
    (
        "mapping values are not allowed",
        "this colon does not fit; a line holds one name and its value, text with a colon has quotes, and the "
        "names of a mapping begin in one column",
    ),
    ("expected alphabetic", "* stands for another value in YAML; an item of a list begins with -"),
    ("another document", "--- begins a second file in YAML; a shot is one file"),
    (
        "<document start>",
        "this line is not indented and those above are; the names of a mapping begin in one column",
    ),
    ("<scalar>", "text goes on after a closing quote; put all of it in quotes, and write ' twice in '…'"),
    (
        "block end",
        "this line does not fit those above; the names of a mapping and the dashes of a list begin in one "
        "column",
    ),
)
"""Parts of the parser's reasons, and what to write."""


def syntax_fault(error: YAMLError, text: str) -> str:
    """Return `line:column: message` about the mistake at which the parser gave up."""
    if isinstance(error, ReaderError):
        before = text[: error.position]
        line, column = before.count("\n"), error.position - before.rfind("\n") - 1
        code = f"U+{ord(text[error.position]):04X}"
        return f"{line + 1}:{column + 1}: the character {code} is not printable; YAML allows none. Remove it."
    lines = [line[:_MOST_CHARACTERS] for line in [*re.split(r"\r\n?|\n", text), ""]]
    line, column, message = _fault(error, lines)
    return f"{line + 1}:{column + 1}: {message}"


def _fault(error: YAMLError, lines: list[str]) -> tuple[int, int, str]:
    """Return line and column, from 0, and the message."""
    mark = context = None
    problem = str(error)
    if isinstance(error, MarkedYAMLError):
        mark, context = error.problem_mark or error.context_mark, error.context_mark
        problem = str(error.problem or error.context)
    line, column = (mark.line, mark.column) if mark else (0, 0)
    begin = (context.line, context.column) if context else (line, column)
    for number in sorted({begin[0], min(line, len(lines) - 1)}):
        if unseen := _UNSEEN.search(lines[number]):
            return number, unseen.start(), unseen_fault(unseen[0])
    for number in {min(line, len(lines) - 1), max(min(line, len(lines)) - 1, 0)}:
        indent = re.match(r"\s*", lines[number])
        if indent and "\t" in indent[0]:
            return number, indent[0].index("\t"), "a tab indents this line; YAML takes spaces only"
    if context and "end of stream" in problem:
        meant = to_yaml(lines[begin[0]][begin[1] + 1 :].strip(), "'")
        return *begin, f"this quote is never closed; write {meant}"
    for number, text in enumerate(lines[: line + 1]):
        if colour := _LOST_COLOUR.search(text):
            message = f"# begins a comment in YAML; put the colour in quotes: '{colour[1]}'"
            return number, colour.start(1), message
    if "expected ',' or" in problem:
        return _open_bracket(lines, line, column, begin, problem)
    if found := re.search(r"(?:found|got) '([]},])'", problem):
        return line, column, f"this {found[1]} closes nothing; remove it"
    if context and "could not find expected ':'" in problem:
        name = re.match(r"\s*[\w.]*", lines[begin[0]])
        word = name[0].strip() if name else ""
        return *begin, f"a colon and a space end a name; write {word}: …"
    for part, message in _REMEDIES:
        if part in problem:
            name = re.match(r"[\s-]*(\w+)", lines[line])
            return line, column, f"{name[1]}: {message}" if name else message
    return line, column, f"{problem}; this is not YAML. Look for a missing colon, quote or bracket, or a tab."


def _open_bracket(
    lines: list[str], line: int, column: int, begin: tuple[int, int], problem: str
) -> tuple[int, int, str]:
    """Return the fault of an entry in brackets that neither a comma nor the closing bracket follows."""
    text = lines[begin[0]][begin[1] :]
    if line > begin[0] or re.search(r"(?:found|got) '[]}]'", problem):
        return *begin, f"this {text[:1]} is never closed; add {'}' if text[:1] == '{' else ']'}"
    words = re.search(r"([\w.]+)\s*$", lines[line][:column])
    return line, column, f"a comma is missing before {words[1] if words else 'this'}"


def unseen_fault(character: str) -> str:
    """Return fact and remedy for a character that nobody sees where YAML has a space or the end of a name."""
    name = unicodedata.name(character, "a character").lower()
    return f"here is {name} (U+{ord(character):04X}), a letter to YAML. Write a plain space, or remove it."


TOO_LARGE = 10**300
"""Whole numbers from here on count as infinite, as decimal numbers do that no float can hold."""

MOST_VALUES, DEEPEST = 100_000, 60
"""Values in one file, with those of aliases each time, and how deep they are nested."""

_TOO_DEEP = (
    "lists and mappings are nested too deep from here on; a shot needs about ten levels. Look for brackets "
    "that never close."
)

_COMMENT = re.compile(r"\s*:?\s+(#.*)$")

_FOLD = "\a"
"""ruamel's mark for the line ends of folded text (`>`)."""

Where = tuple[Any, ...]
"""The path to a value: keys of mappings and indices of lists, from the top."""

Problem = tuple[Where, str]
"""A mistake in a file: the path to it, and the message."""


class Spot(NamedTuple):
    """The position of a key (or list item) in a file; line and column from 1, or 0 for a setting.

    text     line and column of the first character of a text that stands unchanged in one line
    written  a value without quotes, as the file has it: YAML reads 010 as a number
    """

    file: str
    line: int
    column: int
    text: tuple[int, int] | None = None
    written: str = ""


@dataclass(frozen=True)
class YamlSource:
    """A file's text as dicts, lists, numbers and strings.

    places    positions by the paths of values, which may come from other files
    problems  mistakes in the text itself
    """

    path: Path
    data: Any
    places: dict[Where, Spot]
    problems: list[Problem] = field(default_factory=list)

    MOST_BYTES: ClassVar[int] = MOST_BYTES
    """Size of the largest file that is read."""

    @staticmethod
    @lru_cache(maxsize=32)
    def tree(text: str) -> Node | None:
        """Return the tree of nodes of a text, not to be changed: equal texts share one.

        Raises YAMLError, and RecursionError for one too deep.
        """
        yaml = YAML()
        yaml.Scanner = _Scanner
        return yaml.compose(text)

    @staticmethod
    def value_of(node: ScalarNode) -> Any:
        """Return the value of a number, a word or a text in a `tree`."""
        return scalar(node)

    @staticmethod
    def read_text(path: Path) -> str:
        """Return the text of a shot file or an edit. Raises MissingInputError and ShotError."""
        return text_of(path)

    @classmethod
    def read(cls, path: Path, text: str | None = None) -> YamlSource:
        """Parse the file at `path`, or `text` in its place.

        Raises MissingInputError where there is no such file, ShotError where it is not YAML or too large.
        """
        text = text_of(path) if text is None else text
        try:
            return cls._from_node(path, cls.tree(text), text.splitlines())
        except YAMLError as error:
            raise ShotError(f"{path}:{syntax_fault(error, text)}") from None
        except RecursionError:
            raise ShotError(f"{path}:1:1: {_TOO_DEEP}") from None
        except NotImplementedError as error:  # ruamel's answer to a comment within a text
            above = re.search(r"line: (\d+)", str(error))
            raise ShotError(
                f"{path}:{int(above[1]) + 1 if above else 1}:1: a comment stands amid a text that goes on "
                "below it. Put the comment on a line of its own, above the name that the text belongs to."
            ) from None

    @classmethod
    def _from_node(cls, path: Path, node: Node | None, lines: list[str]) -> YamlSource:
        if node is None:
            raise ShotError(f"{path}:1:1: the file is empty; it must hold at least title, frames and subject")
        reader = _Reader(str(path), lines)
        return cls(path, reader.value(node, (), ()), reader.places, reader.problems)

    def place(self, where: Where) -> str:
        """Return `file:line:column` of a path, or of the nearest mapping or list around it."""
        file, line, column, *_ = self.spot_of(where)
        return f"{file}:{line}:{column}" if line else file

    def order(self, where: Where) -> tuple[bool, str, int, int]:
        """Return a sort key that orders paths by position, those of the file itself first."""
        file, line, column, *_ = self.spot_of(where)
        return file != str(self.path), file, line, column

    def spot_of(self, where: Where) -> Spot:
        """Return the position of a path, or of the nearest mapping or list around it."""
        for length in range(len(where), -1, -1):
            if where[:length] in self.places:
                return self.places[where[:length]]
        return Spot(str(self.path), 1, 1)

    def spot(self, where: Where, column: int) -> Where | None:
        """Return a path to a character (from 1) of a text; None if the file writes it otherwise."""
        spot = self.places.get(where)
        if spot is None or spot.text is None:
            return None
        line, first = spot.text
        self.places[(*where, column)] = Spot(spot.file, line, first + column - 1)
        return (*where, column)

    def get(self, *where: Any) -> Any:
        """Return the value at a path, or None."""
        value = self.data
        for step in where:
            try:
                value = value[step]
            except (KeyError, IndexError, TypeError):
                return None
        return value

    def mapping(self, *where: Any) -> dict[Any, Any]:
        """Return the mapping at a path; an empty one where something else stands or nothing."""
        value = self.get(*where)
        return value if isinstance(value, dict) else {}

    def listing(self, *where: Any) -> list[Any]:
        """Return the list at a path; an empty one where something else stands or nothing."""
        value = self.get(*where)
        return value if isinstance(value, list) else []

    def without_places(self, is_dropped: Callable[[Where], bool]) -> YamlSource:
        """Return the same data without the positions of some paths."""
        kept = {where: spot for where, spot in self.places.items() if not is_dropped(where)}
        return replace(self, places=kept)

    def mappings(self) -> Iterator[tuple[Where, dict[Any, Any]]]:
        """Yield all mappings of the file with their paths, from the top down."""
        waiting: deque[tuple[Where, Any]] = deque([((), self.data)])
        while waiting:
            where, value = waiting.popleft()
            if isinstance(value, dict):
                yield where, value
                waiting += [((*where, key), inner) for key, inner in value.items()]
            elif isinstance(value, list):
                waiting += [((*where, index), inner) for index, inner in enumerate(value)]


@dataclass
class _Reader:
    """Converts a tree of nodes to plain values, and notes places and problems on the way."""

    file: str
    lines: list[str]
    places: dict[Where, Spot] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)
    values: int = 0
    characters: int = 0

    def value(self, node: Node, where: Where, parents: tuple[Node, ...], before: Any = None) -> Any:
        """Convert a node. before: the mark where its name ends, if it has one."""
        self._count(node, len(parents))
        self.places.setdefault(where, self._spot(node))
        if any(node is parent for parent in parents):
            self.problems.append((where, "this alias contains itself; write the value out"))
            return None
        if isinstance(node, MappingNode):
            return self._mapping(node, where, (*parents, node))
        if isinstance(node, SequenceNode):
            items = enumerate(node.value)
            return [self.value(item, (*where, index), (*parents, node)) for index, item in items]
        if not isinstance(node, ScalarNode):
            return None
        self._note_text(node, where)
        if colour := self._lost_colour(before or node.start_mark, node):
            fact = f"{dotted_path(where)}: empty, since # begins a comment in YAML"
            self.problems.append((where, f"{fact}. Put the colour in quotes: '{colour}'."))
        return colour or scalar(node)

    def _count(self, node: Node, depth: int) -> None:
        """Raise ShotError where the values, of aliases again each time, become too many or too deep."""
        self.values += 1
        self.characters += len(node.value) if isinstance(node, ScalarNode) else 0
        fault = _TOO_DEEP if depth > DEEPEST else None
        if self.values > MOST_VALUES or self.characters > 4 * MOST_BYTES:
            fault = (
                f"with this value the file holds more than {MOST_VALUES} values, or their text is too long; "
                "aliases (*name) count each time. Shorten it."
            )
        if fault:
            raise ShotError(f"{self.file}:{node.start_mark.line + 1}:{node.start_mark.column + 1}: {fault}")

    def _spot(self, node: Node) -> Spot:
        return Spot(self.file, node.start_mark.line + 1, node.start_mark.column + 1)

    def _note_text(self, node: ScalarNode, where: Where) -> None:
        """Note how a value is written, and where its text begins if its characters stand there one by one."""
        written = "" if node.style else node.value
        self.places[where] = self.places[where]._replace(written=written)
        start, end = node.start_mark, node.end_mark
        quotes = 1 if node.style in ("'", '"') else 0
        if start.line == end.line and end.column - start.column == len(node.value) + 2 * quotes:
            text = start.line + 1, start.column + 1 + quotes
            self.places[where] = self.places[where]._replace(text=text)

    def _mapping(self, node: MappingNode, where: Where, parents: tuple[Node, ...]) -> dict[Any, Any]:
        values: dict[Any, Any] = {}
        for key_node, value_node in node.value:
            if not isinstance(key_node, ScalarNode):
                place = (*where, ("name", key_node.start_mark.index))
                self.places[place] = self._spot(key_node)
                self.problems.append((place, "a list or mapping is not a name; names are text"))
                continue
            key = scalar(key_node)
            if not key_node.style and (unseen := _UNSEEN.search(key_node.value)):
                mark = key_node.start_mark
                spot = f"{self.file}:{mark.line + 1}:{mark.column + 1}"
                raise ShotError(f"{spot}: {dotted_path((*where, key))}: {unseen_fault(unseen[0])}")
            if key in values:
                line = self.places[(*where, key)].line
                problem = (
                    f"{key} is given twice, first in line {line}; one would be lost. Remove one of them."
                )
                self.places[(*where, key, "again")] = self._spot(key_node)
                self.problems.append(((*where, key, "again"), problem))
                continue
            self.places[(*where, key)] = self._spot(key_node)
            values[key] = self.value(value_node, (*where, key), parents, key_node.end_mark)
        return values

    def _lost_colour(self, before: Any, value: ScalarNode) -> str | None:
        """Return the colour that stands as a comment after a mark, in place of a value; None if none does."""
        if value.style or value.value:
            return None
        line = self.lines[before.line] if before.line < len(self.lines) else ""
        comment = _COMMENT.match(line, before.column)
        colour = HEX_COLOUR.match(comment[1]) if comment else None
        return colour[0] if colour else None


class _Scanner(RoundTripScanner):
    """ruamel's scanner with a bound on nested brackets, whose time grows with the square of their depth."""

    def fetch_flow_collection_start(self, TokenClass: Any, to_push: str) -> None:
        if len(self.flow_context) > DEEPEST:
            raise RecursionError
        super().fetch_flow_collection_start(TokenClass, to_push)


def scalar(node: ScalarNode) -> Any:
    """Convert a scalar by the core schema of YAML 1.2; quoted ones are text."""
    text = node.value.replace(_FOLD, "") if node.style == ">" else node.value
    kind = str(node.tag).rpartition(":")[2]
    try:
        if kind == "int":
            based = text.lstrip("+-")[:2].lower() in ("0x", "0o")
            whole = int(text.replace("_", ""), 0) if based else int(text)
            return whole if abs(whole) < TOO_LARGE else math.inf if whole > 0 else -math.inf
        if kind == "float":
            return float(text.replace(".inf", "inf").replace(".nan", "nan").replace(".NaN", "nan"))
    except ValueError:
        return text
    if kind == "bool":
        return text.lower() == "true"
    return None if kind == "null" else text


MOST_CHARACTERS = 100
"""Longest value that a message writes out."""

_PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_./-]*( [A-Za-z0-9_./+*-]+)*|\d+(\.\d+)?s")
_WORDS = ("true", "false", "null", "True", "False", "Null", "TRUE", "FALSE", "NULL")


def dotted_path(where: Where) -> str:
    """Return a path as `--set` has it: flows.0.vortex."""
    return ".".join(shorten(step) for step in where)


def listed(names: Iterable[Any], last: str = "and") -> str:
    """Return names as a sentence lists them: a, b and c."""
    texts = [str(name) for name in names]
    return f" {last} ".join([", ".join(texts[:-1]), texts[-1]] if len(texts) > 1 else texts)


def in_yaml(value: Any) -> str:
    """Return a value as a shot file writes it in one line: `{axis: y, amount: 80}`; long ones are cut."""
    text = "" if value is None else to_yaml(value)
    if len(text) <= MOST_CHARACTERS:
        return text
    if isinstance(value, dict):
        names = "{" + ", ".join(f"{name}: …" for name in value) + "}"
        return names if len(names) <= 2 * MOST_CHARACTERS else f"{names[:MOST_CHARACTERS]}…}}"
    return f"{text[:MOST_CHARACTERS]}…"


def shown(value: Any) -> str:
    """Return a value for a message: mappings and long lists by their kind, texts in quotes."""
    if isinstance(value, dict):
        return "a mapping"
    if isinstance(value, list):
        return "a list"
    if isinstance(value, bool):
        return str(value).lower()
    return "empty" if value is None else quote(value)


def to_yaml(value: Any, quote: str = '"') -> str:
    """Return plain data as one line that reads back as the same values, YAML's flow style: `{axis: y}`.

    quote  the quotation mark around a text that needs one, where the text allows it

    Numbers are written in the fewest digits that read back as the same double.
    """
    if isinstance(value, dict):
        return "{" + ", ".join(f"{to_yaml(name)}: {to_yaml(item)}" for name, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(to_yaml, value)) + "]"
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float) and value.is_integer() and abs(value) < 1e15:
        return str(int(value))
    if isinstance(value, int | float):
        return repr(value)
    text = str(value)
    if quote == "'" and "'" not in text and text.isprintable():
        return f"'{text}'"
    return text if _PLAIN.fullmatch(text) and text not in _WORDS else json.dumps(text, ensure_ascii=False)
