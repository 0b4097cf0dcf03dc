"""Edits of a shot file's text: values are set, removed and renamed, and nothing else moves.

Only the characters of the edited value are replaced, at the positions of ruamel's nodes; comments, order,
blank lines and quotes stay. The new text is parsed again and compared with the same edits of the data, so an
edit arrives as it was meant or is refused.
"""

from __future__ import annotations

import copy
import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from flowsculpt.api import ShotError
from flowsculpt.api.shots import YamlSource, to_yaml


def replaced(text: str, start: int, end: int, words: str) -> str:
    """Return a text with other words from `start` to `end`."""
    return text[:start] + words + text[end:]


def node_end(text: str, node: Node) -> int:
    """Return the index after the last character of a node, without blank lines and comments behind it."""
    if isinstance(node, MappingNode | SequenceNode) and not node.flow_style and node.value:
        last = node.value[-1]
        return entry_end(text, *last) if isinstance(last, tuple) else node_end(text, last)
    start, end = node.start_mark.index, node.end_mark.index
    while end > start and text[end - 1].isspace():
        end -= 1
    return int(end)


def entry_end(text: str, key: Node, value: Node) -> int:
    """Return the index after an entry of a mapping: of one without a value after its colon.

    ruamel has the place of an empty value behind the comments that follow it.
    """
    if value.start_mark.index == value.end_mark.index:
        return text.index(":", key.end_mark.index) + 1
    return node_end(text, value)


class TextMapping:
    """A mapping of a file with the spans of its entries."""

    def __init__(self, text: str, node: MappingNode) -> None:
        self.text, self.node = text, node
        self.names: list[Any] = [YamlSource.value_of(key) for key, _ in node.value]

    def key_span(self, index: int) -> tuple[int, int]:
        """Return start and end of an entry's name."""
        key = self.node.value[index][0]
        return key.start_mark.index, key.end_mark.index

    def value_text(self, index: int) -> str:
        """Return the text of an entry's value."""
        value = self.node.value[index][1]
        return self.text[value.start_mark.index : max(value.start_mark.index, self.end(index))]

    def with_entry(self, position: int, entry: str) -> str:
        """Return the text with an entry `name: value` at a position among the others."""
        if not self.names:
            start = self.node.start_mark.index + 1
            return replaced(self.text, start, start, entry)
        if self.node.flow_style:
            if position < len(self.names):
                start = self.key_span(position)[0]
                return replaced(self.text, start, start, f"{entry}, ")
            end = self.end(position - 1)
            return replaced(self.text, end, end, f", {entry}")
        indent = " " * self.node.value[0][0].start_mark.column
        if position == 0:
            start = self.key_span(0)[0]
            return replaced(self.text, start, start, f"{entry}\n{indent}")
        end = self._line_end(self.end(position - 1))
        return replaced(self.text, end, end, f"\n{indent}{entry}")

    def joined(self, entries: Sequence[str]) -> str:
        """Return entries as they stand one after another here."""
        if self.node.flow_style:
            return ", ".join(entries)
        return f"\n{' ' * self.node.value[0][0].start_mark.column}".join(entries)

    def without(self, index: int) -> str | None:
        """Return the text without an entry; None where that would lose a comment or leave no mapping."""
        start, end = self.key_span(index)[0], self.end(index)
        if "#" in self.text[start:end] and "\n" in self.text[start:end]:
            return None
        without = self._without_in_brackets if self.node.flow_style else self._without_lines
        return without(index, start, end)

    def _without_in_brackets(self, index: int, start: int, end: int) -> str:
        comma = re.compile(r"\s*,[ \t]*").match(self.text, end)
        if comma is not None and index + 1 < len(self.names):
            return replaced(self.text, start, comma.end(), "")
        if index and not re.search(r"[\n#]", self.text[self.end(index - 1) : start]):
            return replaced(self.text, self.end(index - 1), end, "")
        return replaced(self.text, start, comma.end() if comma else end, "")

    def _without_lines(self, index: int, start: int, end: int) -> str | None:
        """Return the text without the lines of an entry; a comment behind it stays, on a line of its own."""
        if len(self.names) == 1:
            return None
        line, head = self._line_end(end), self.text.rfind("\n", 0, start) + 1
        comment = self.text[end:line].strip()
        if self.text[head:start].strip():  # the dash of a list stands before the first name
            following = self.key_span(index + 1)[0]
            return None if "#" in self.text[end:following] else replaced(self.text, start, following, "")
        if comment:
            return replaced(self.text, start, line, comment)
        return replaced(self.text, head, min(line + 1, len(self.text)), "")

    def end(self, index: int) -> int:
        """Return the index after an entry."""
        return entry_end(self.text, *self.node.value[index])

    def _line_end(self, index: int) -> int:
        end = self.text.find("\n", index)
        return len(self.text) if end < 0 else end


Where = tuple[Any, ...]
"""The path to a value: names of mappings and indices of lists, from the top."""


def path_text(where: Where) -> str:
    """Return a path as messages and `--set` have it: flows.0.vortex."""
    return ".".join(map(str, where))


_NUMBER = re.compile(r"-?\d{1,12}(\.\d{1,12})?")


def with_times(value: Any) -> Any:
    """Return data whose names of numbers are numbers, as times of keys are: JSON has names of text only."""
    if isinstance(value, dict):
        return {_number_or_text(name): with_times(item) for name, item in value.items()}
    return [with_times(item) for item in value] if isinstance(value, list) else value


def _number_or_text(name: str) -> Any:
    if not _NUMBER.fullmatch(name):
        return name
    return float(name) if "." in name else int(name)


TimeOf = Callable[[Any], float | None]
"""Returns the time of a key in seconds; None for what is not a time."""


@dataclass(frozen=True)
class KeySpan:
    """Keys in place of all others from one time to another, both included, in seconds of the shot."""

    first: float
    last: float
    keys: dict[Any, Any]

    def holds(self, seconds: float | None) -> bool:
        """Tell whether a key at a time is replaced."""
        return seconds is not None and self.first - SAME_TIME <= seconds <= self.last + SAME_TIME


SAME_TIME = 1e-9  # seconds by which times of one key may differ by rounding


@dataclass(frozen=True)
class ValueEdit:
    """One change of a file.

    kind   `set` replaces or adds `value`, `remove` takes a name out of its mapping, `rename` gives it the
           name `value`, such as another time of a key; `keys` puts a KeySpan into the `keys` at `where`
    where  the path: names of mappings and indices of lists
    """

    kind: Literal["set", "remove", "rename", "keys"]
    where: Where
    value: Any = None


@lru_cache(maxsize=4)
def parsed(path: Path, text: str) -> YamlSource:
    """Return the source of a text, which is only read. Raises ShotError where it is not YAML."""
    return YamlSource.read(path, text)


def edited(path: Path, text: str, edits: Iterable[ValueEdit], time_of: TimeOf, verify: bool = True) -> str:
    """Return the text of a shot file after edits, which are made in order.

    time_of  gives the order of keys: a new one is sorted in
    verify   whether the text is compared with the edits; a text that is not written need not be

    Raises ShotError where the file has no such place, or where the edit would lose a comment or change
    another value too.
    """
    for edit in edits:
        before = parsed(path, text)
        wanted = _edited_data(before, edit, time_of)
        changed = _Editor(before, text, time_of).apply(edit)
        try:
            arrived = not verify or parsed(path, changed).data == wanted
        except ShotError:
            arrived = False
        if not arrived:
            raise _refused(before, edit.where, "is written in a form that cannot be edited in place")
        text = changed
    return text


def _refused(source: YamlSource, where: Where, fact: str) -> ShotError:
    return ShotError(f"{source.place(where)}: {path_text(where)} {fact}. Edit it in the file.")


def _edited_data(source: YamlSource, edit: ValueEdit, time_of: TimeOf) -> Any:
    """Return the data of a file after an edit."""
    data = copy.deepcopy(source.data)
    *steps, last = edit.where
    holder = data
    for depth, step in enumerate(steps):
        if isinstance(holder, dict) and edit.kind == "set" and holder.get(step) is None:
            holder[step] = {}
        try:
            holder = holder[step]
        except (KeyError, IndexError, TypeError):
            raise _missing(source, edit.where, depth) from None
    is_item = isinstance(holder, list) and isinstance(last, int) and 0 <= last < len(holder)
    if not (isinstance(holder, dict) or (is_item and edit.kind == "set")):
        raise _missing(source, edit.where, len(steps))
    if edit.kind == "set":
        holder[last] = copy.deepcopy(edit.value)
        return data
    if last not in holder or (edit.kind == "keys" and not isinstance(holder[last], dict)):
        raise _missing(source, edit.where, len(steps))
    if edit.kind == "keys":
        kept = {time: key for time, key in holder[last].items() if not edit.value.holds(time_of(time))}
        holder[last] = kept | edit.value.keys
        return data
    value = holder.pop(last)
    if edit.kind == "rename":
        if edit.value in holder:
            raise _refused(source, edit.where, f"cannot be renamed to {edit.value}, which is there already")
        holder[edit.value] = value
    return data


def _missing(source: YamlSource, where: Where, depth: int) -> ShotError:
    place, name = source.place(where[:depth]), path_text(where[:depth]) or "the file"
    return ShotError(f"{place}: {name} has no {where[depth]} that could be edited. Write it in the file.")


@dataclass
class _Editor:
    """Applies one edit to a text."""

    source: YamlSource
    text: str
    time_of: TimeOf

    def apply(self, edit: ValueEdit) -> str:
        if edit.kind == "set":
            return self._set(edit.where, edit.value)
        nodes = self._nodes(edit.where)
        if edit.kind == "keys":
            assert isinstance(nodes[-1], MappingNode), "the data has keys here"
            return self._with_keys(TextMapping(self.text, nodes[-1]), edit.value, edit.where)
        parent = nodes[-2]
        assert isinstance(parent, MappingNode), "the data has a mapping here"
        mapping = TextMapping(self.text, parent)
        index = mapping.names.index(edit.where[-1])
        if edit.kind == "remove":
            return self._removed(mapping, index, edit.where)
        return self._renamed(mapping, index, edit)

    def _with_keys(self, mapping: TextMapping, span: KeySpan, where: Where) -> str:
        """Return the text with some keys in place of others, all at once: there may be hundreds."""
        times = [self.time_of(name) for name in mapping.names]
        inside = [index for index, time in enumerate(times) if span.holds(time)]
        entries = [f"{to_yaml(time)}: {to_yaml(key)}" for time, key in span.keys.items()]
        if not inside:
            position = sum(time is not None and time < span.first for time in times)
            return mapping.with_entry(position, mapping.joined(entries))
        start, end = mapping.key_span(inside[0])[0], mapping.end(inside[-1])
        if "#" in self.text[start:end] and "\n" in self.text[start:end]:
            raise _refused(self.source, where, "has comments between the keys that would go")
        return replaced(self.text, start, end, mapping.joined(entries))

    def _removed(self, mapping: TextMapping, index: int, where: Where) -> str:
        text = mapping.without(index)
        if text is None:
            raise _refused(self.source, where, "is the only entry here, or has comments within")
        return text

    def _renamed(self, mapping: TextMapping, index: int, edit: ValueEdit) -> str:
        names = [name for i, name in enumerate(mapping.names) if i != index]
        if self._position(edit.where, names, edit.value) == index:
            return replaced(self.text, *mapping.key_span(index), to_yaml(edit.value))
        value = mapping.value_text(index)
        if "\n" in value:
            raise _refused(self.source, edit.where, "is written over several lines")
        self.text = self._removed(mapping, index, edit.where)
        return self._inserted((*edit.where[:-1], edit.value), value)

    def _set(self, where: Where, value: Any) -> str:
        """Return the text with a value replaced or added."""
        nodes = self._nodes(where)
        if len(nodes) <= len(where):
            depth = len(nodes)  # of the first name that is not there
            for name in reversed(where[depth:]):
                value = {name: value}
            return self._inserted(where[:depth], to_yaml(value))
        node = nodes[-1]
        if isinstance(node, MappingNode) and isinstance(value, dict) and value and node.value:
            return self._merged(where, node, value)
        if isinstance(node, SequenceNode) and isinstance(value, list) and len(value) == len(node.value):
            for index, item in enumerate(value):
                self.text = self._set((*where, index), item)
            return self.text
        start, end = self._span(nodes[-2], node)
        former = self.text[start:end]
        is_block = isinstance(node, MappingNode | SequenceNode) and not node.flow_style
        if is_block or ("\n" in former and ("#" in former or former[:1] in "|>")):
            raise _refused(self.source, where, "is written over several lines")
        words = to_yaml(value, former[:1])
        return replaced(self.text, start, end, f" {words}" if start == end else words)

    def _merged(self, where: Where, node: MappingNode, value: dict[Any, Any]) -> str:
        """Return the text with the entries of one mapping made those of another, one by one."""
        there = [YamlSource.value_of(key) for key, _ in node.value]
        for name, item in value.items():
            if name not in there or self.source.get(*where, name) != item:
                self.text = self._set((*where, name), item)
        for name in there:
            if name not in value:
                self.text = self.apply(ValueEdit("remove", (*where, name)))
        return self.text

    def _inserted(self, where: Where, words: str) -> str:
        """Return the text with a new entry in a mapping that is there, or in an empty value."""
        *parents, name = where
        nodes = self._nodes(tuple(parents))
        node, entry = nodes[-1], f"{to_yaml(name)}: {words}"
        if isinstance(node, MappingNode) and (node.value or node.flow_style):
            mapping = TextMapping(self.text, node)
            return mapping.with_entry(self._position(where, mapping.names, name), entry)
        if isinstance(node, ScalarNode) and YamlSource.value_of(node) is None:
            start, end = self._span(nodes[-2], node)
            return replaced(self.text, start, end, f" {{{entry}}}" if start == end else f"{{{entry}}}")
        raise _refused(self.source, where[:-1], "is not a mapping")

    def _span(self, parent: Node, node: Node) -> tuple[int, int]:
        """Return start and end of a value; both are behind the colon of a name without one."""
        if node.start_mark.index < node.end_mark.index or not isinstance(parent, MappingNode):
            return node.start_mark.index, node_end(self.text, node)
        end = next(entry_end(self.text, key, value) for key, value in parent.value if value is node)
        return end, end

    def _position(self, where: Where, names: list[Any], name: Any) -> int:
        """Return where a name goes among others: last, and in order among the times of keys."""
        if where[-2:-1] != ("keys",):
            return len(names)
        time, *times = (self.time_of(each) for each in (name, *names))
        known = [other for other in times if other is not None]
        if time is None or len(known) < len(times):
            return len(names)
        return sum(other < time + math.ulp(time) for other in known)

    def _nodes(self, where: Where) -> list[Node]:
        """Return the nodes along a path from the top, as far as they are there."""
        root = YamlSource.tree(self.text)
        assert root is not None, "a file that was read is not empty"
        nodes, node = [root], root
        for step in where:
            if (inner := self._step(node, step)) is None:
                break
            node = inner
            nodes.append(node)
        if any(_shared(root, node) for node in nodes):
            raise _refused(self.source, where, "is written once for several places (an alias)")
        return nodes

    def _step(self, node: Node, step: Any) -> Node | None:
        if isinstance(node, MappingNode):
            return next((value for key, value in node.value if YamlSource.value_of(key) == step), None)
        is_item = isinstance(node, SequenceNode) and isinstance(step, int) and 0 <= step < len(node.value)
        return node.value[step] if is_item else None


def _shared(root: Node, wanted: Node) -> bool:
    """Tell whether a node stands in several places of a tree."""
    found, waiting = 0, [root]
    while waiting:
        node = waiting.pop()
        found += node is wanted
        if isinstance(node, MappingNode):
            waiting += [value for _, value in node.value]
        elif isinstance(node, SequenceNode):
            waiting += node.value
    return found > 1
