"""Entries of a mapping as spans of a file's text: found, added and removed without changing others."""

from __future__ import annotations

import re
from typing import Any

from ruamel.yaml.nodes import MappingNode, Node, SequenceNode

from pipeline.shot.yaml.source import scalar


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
        self.names: list[Any] = [scalar(key) for key, _ in node.value]

    def index(self, name: Any) -> int:
        """Return the position of a name, which is there."""
        return self.names.index(name)

    def key_span(self, index: int) -> tuple[int, int]:
        """Return start and end of an entry's name."""
        key = self.node.value[index][0]
        return key.start_mark.index, key.end_mark.index

    def value_text(self, index: int) -> str:
        """Return the text of an entry's value."""
        value = self.node.value[index][1]
        return self.text[value.start_mark.index : max(value.start_mark.index, self._end(index))]

    def with_entry(self, position: int, entry: str) -> str:
        """Return the text with an entry `name: value` at a position among the others."""
        if not self.names:
            start = self.node.start_mark.index + 1
            return replaced(self.text, start, start, entry)
        if self.node.flow_style:
            if position < len(self.names):
                start = self.key_span(position)[0]
                return replaced(self.text, start, start, f"{entry}, ")
            end = self._end(position - 1)
            return replaced(self.text, end, end, f", {entry}")
        indent = " " * self.node.value[0][0].start_mark.column
        if position == 0:
            start = self.key_span(0)[0]
            return replaced(self.text, start, start, f"{entry}\n{indent}")
        end = self._line_end(self._end(position - 1))
        return replaced(self.text, end, end, f"\n{indent}{entry}")

    def without(self, index: int) -> str | None:
        """Return the text without an entry; None where that would lose a comment or leave no mapping."""
        start, end = self.key_span(index)[0], self._end(index)
        if "#" in self.text[start:end] and "\n" in self.text[start:end]:
            return None
        if self.node.flow_style:
            return self._without_in_brackets(index, start, end)
        return self._without_lines(index, start, end)

    def _without_in_brackets(self, index: int, start: int, end: int) -> str:
        comma = re.compile(r"\s*,[ \t]*").match(self.text, end)
        if comma is not None and index + 1 < len(self.names):
            return replaced(self.text, start, comma.end(), "")
        if index and not re.search(r"[\n#]", self.text[self._end(index - 1) : start]):
            start = self._end(index - 1)
            return replaced(self.text, start, end, "")
        return replaced(self.text, start, comma.end() if comma else end, "")

    def _without_lines(self, index: int, start: int, end: int) -> str | None:
        """Return the text without the lines of an entry; a comment behind it stays, on a line of its own."""
        if len(self.names) == 1:
            return None
        line = self._line_end(end)
        comment = self.text[end:line].strip()
        head = self.text.rfind("\n", 0, start) + 1
        if self.text[head:start].strip():  # the dash of a list stands before the first name
            following = self.key_span(index + 1)[0]
            between = self.text[end:following]
            return None if "#" in between else replaced(self.text, start, following, "")
        if comment:
            return replaced(self.text, start, line, comment)
        return replaced(self.text, head, min(line + 1, len(self.text)), "")

    def _end(self, index: int) -> int:
        return entry_end(self.text, *self.node.value[index])

    def _line_end(self, index: int) -> int:
        end = self.text.find("\n", index)
        return len(self.text) if end < 0 else end
