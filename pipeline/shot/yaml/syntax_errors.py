"""Messages about text that is not YAML: what the line means to say, and how YAML wants it written."""

from __future__ import annotations

import re
from dataclasses import dataclass

from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.reader import ReaderError

HEX_COLOUR = re.compile(r"#(?:[0-9a-fA-F]{3}){1,2}(?![0-9a-zA-Z])")
"""A colour as web pages have it. Outside of quotes YAML takes it as a comment."""

_OPENING = {"}": "{", "]": "["}
_CLOSING = {"{": "}", "[": "]"}

_MOST_CHARACTERS = 1000

Fault = tuple[int, int, str]
"""Line and column, from 0, and the message."""


def syntax_fault(error: YAMLError, text: str) -> str:
    """Return `line:column: message` about the mistake at which the parser gave up."""
    if isinstance(error, ReaderError):
        before = text[: error.position]
        line, column = before.count("\n"), error.position - before.rfind("\n") - 1
        code = f"U+{ord(text[error.position]):04X}"
        return f"{line + 1}:{column + 1}: the character {code} is not printable; YAML allows none. Remove it."
    line, column, message = _Failure.of(error, text).fault()
    return f"{line + 1}:{column + 1}: {message}"


@dataclass(frozen=True)
class _Failure:
    """The place at which a parser gave up, the place where that part of the file begins, and the reason."""

    lines: list[str]
    line: int
    column: int
    begin: tuple[int, int] | None
    problem: str

    @classmethod
    def of(cls, error: YAMLError, text: str) -> _Failure:
        problem = context = None
        mark, fact = None, str(error)
        if isinstance(error, MarkedYAMLError):
            problem, context = error.problem_mark, error.context_mark
            mark, fact = problem or context, str(error.problem or error.context)
        line, column = (mark.line, mark.column) if mark else (0, 0)
        begin = (context.line, context.column) if context else None
        return cls([*text.splitlines(), ""], line, column, begin, fact)

    def fault(self) -> Fault:
        for diagnosis in (
            self._tab,
            self._first_character,
            self._alias,
            self._open_quote,
            self._bracket,
            self._dash,
            self._too_far_left,
            self._second_colon,
            self._no_colon,
            self._after_quote,
            self._documents,
        ):
            if (fault := diagnosis()) is not None:
                return fault
        message = f"{self.problem}; this is not YAML. Look for a missing colon, quote or bracket, or a tab."
        return self.line, self.column, message

    def _text(self, line: int) -> str:
        """Return the beginning of a line: nobody writes more, and patterns take long on more."""
        return self.lines[line][:_MOST_CHARACTERS] if line < len(self.lines) else ""

    def _tab(self) -> Fault | None:
        for line in {self.line, max(self.line - 1, 0)}:
            indent = re.match(r"\s*", self._text(line))
            if indent and "\t" in indent[0]:
                column = indent[0].index("\t")
                return line, column, "a tab indents this line; YAML takes spaces only. Replace it by spaces."
        return None

    def _first_character(self) -> Fault | None:
        if "cannot start any token" not in self.problem:
            return None
        value = _without_comment(self._text(self.line)[self.column :])
        message = f"no text begins with {value[:1]} in YAML. Put it in quotes: {quoted(value)}."
        return self.line, self.column, message

    def _alias(self) -> Fault | None:
        if item := re.match(r"(\s*)\*\s+(\S.*)$", self._text(self.line)):
            fact = "an item of a list begins with a dash, not with *"
            return self.line, item.end(1), f"{fact}. Write - {item[2]}."
        match = re.search(r"undefined alias '(.*)'", self.problem)
        if not match:
            return None
        return (
            self.line,
            self.column,
            f"*{match[1]} stands for a value marked &{match[1]} in YAML, and none is. Put text that begins "
            f"with * in quotes: '*{match[1]}'.",
        )

    def _open_quote(self) -> Fault | None:
        if self.begin is None or "end of stream" not in self.problem:
            return None
        line, column = self.begin
        return line, column, f"this quote is never closed. Write {quoted(self._text(line)[column + 1 :])}."

    def _bracket(self) -> Fault | None:
        found = re.search(r"(?:found|got) '(.|<[\w ]+>)'", self.problem)
        found_text = found[1] if found else ""
        if "expected ',' or" not in self.problem or self.begin is None:
            if found_text in _OPENING:
                return self.line, self.column, f"this {found_text} closes nothing. Remove it."
            if found_text == ",":
                return self.line, self.column, "there is no value before this comma. Remove it."
            return None
        line, column = self.begin
        text = self._text(line)
        opening = text[column : column + 1]
        comment = re.search(r"\s(#.*)$", text[column:])
        if comment and (colour := HEX_COLOUR.match(comment[1])):
            return (
                line,
                column + comment.start(1),
                f"# begins a comment in YAML, so the rest of this line is lost. Put the colour in quotes: "
                f"'{colour[0]}'.",
            )
        if self.line > line or found_text in _OPENING:
            return (
                line,
                column,
                f"this {opening} is never closed. Add {_CLOSING.get(opening, 'its bracket')}.",
            )
        words = re.search(r"([\w.]+)\s*$", text[: self.column])
        before = f" before {words[1]}" if words else ""
        return self.line, self.column, f"a comma is missing{before}. Separate entries by commas."

    def _dash(self) -> Fault | None:
        if "block end" not in self.problem or not self._text(self.line)[self.column :].startswith("-"):
            return None
        if self.column == 0:
            fact = "a dash begins an item of a list, and the names of the file go on here"
            return self.line, 0, f"{fact}. Remove the dash, or indent it below the name of its list."
        for number in range(self.line - 1, -1, -1):
            if (item := re.match(r"(\s*)- ", self._text(number))) and len(item[1]) != self.column:
                return (
                    self.line,
                    self.column,
                    f"this dash is indented by {self.column} and the one in line {number + 1} by "
                    f"{len(item[1])}; the items of a list begin in one column. {_indent(len(item[1]))}",
                )
        fact = "a dash begins an item of a list, and the lines before are no list"
        return self.line, self.column, f"{fact}. Remove the dash."

    def _too_far_left(self) -> Fault | None:
        """Return the fault of a line that begins between the columns of its mapping and of the one around.

        The parser gives up at the first line in another column; the odd one of the two is that with fewer
        lines in its column.
        """
        if "block end" not in self.problem or "block mapping start" not in self.problem:
            return None
        above = next((n for n in range(self.line - 1, -1, -1) if _without_comment(self._text(n))), None)
        if above is None or self._start(above) <= self._start(self.line):
            return None
        there, here = self._start(above), self._start(self.line)
        before = self._count(range(above, -1, -1), there)
        if before == 1 and self._count(range(self.line, len(self.lines)), here) > 1:
            return above, there, self._odd(above, "the line below", here)
        near = min(self._outer(above), key=lambda line: abs(self._start(line) - here))
        place = "the line above" if near == above else f"line {near + 1}"
        return self.line, here, self._odd(self.line, place, self._start(near))

    def _outer(self, line: int) -> list[int]:
        """Return a line and those before it that begin further left than all between."""
        outer = [line]
        for number in range(line - 1, -1, -1):
            if _without_comment(self._text(number)) and self._start(number) < self._start(outer[-1]):
                outer.append(number)
        return outer

    def _start(self, line: int) -> int:
        """Return the column of the first name of a line."""
        text = self._text(line)
        return len(text) - len(text.lstrip(" \t-"))

    def _count(self, lines: range, column: int) -> int:
        """Return how many of these lines, up to one further left, begin in a column."""
        starts = [self._start(n) for n in lines if _without_comment(self._text(n))]
        starts = starts[: next((k for k, start in enumerate(starts) if start < column), len(starts))]
        return starts.count(column)

    def _odd(self, line: int, place: str, column: int) -> str:
        """Return the message about a line that must begin in the column of another place."""
        name = self._text(line).strip(" -").partition(":")[0]
        return (
            f"{name} is indented by {self._start(line)} and {place} by {column}; the names of a mapping "
            f"begin in one column. {_indent(column)}"
        )

    def _second_colon(self) -> Fault | None:
        if "mapping values are not allowed" not in self.problem:
            return None
        text = self._text(self.line)
        brace = re.match(r"\s*((?:- )?)(\w+)\s*(\{.*\})\s*$", text)
        if brace:
            fact = f"a colon is missing after {brace[2]}"
            return self.line, brace.end(2), f"{fact}. Write {brace[1]}{brace[2]}: {brace[3]}."
        entry = re.match(r"(\s*(?:- )?)([^:]+): +(.*)$", text)
        if entry and self.column > entry.end(2):
            name, value = entry[2], _without_comment(entry[3])
            is_name = re.match(r"[a-z_]+: \S", value)
            rest = f"{{{value}}}" if is_name else quoted(value)
            fact = "one line holds one name and its value" if is_name else "text with a colon needs quotes"
            return self.line, entry.start(3), f"{fact}. Write {name}: {rest}."
        return self._indented()

    def _indented(self) -> Fault | None:
        """Return the fault of a line that is right alone, and does not fit the one above."""
        above = next((n for n in range(self.line - 1, -1, -1) if _without_comment(self._text(n))), None)
        if above is None:
            return None
        before = self._text(above)
        if ":" not in _without_comment(before):
            word = before.strip()
            return above, len(before) - len(before.lstrip()), f"{word} has no colon. Write {word}:"
        here = self._start(self.line)
        return self.line, here, self._odd(self.line, "the line above", self._start(above))

    def _no_colon(self) -> Fault | None:
        if "could not find expected ':'" not in self.problem or self.begin is None:
            return None
        line = self.begin[0]
        entry = re.match(r"(\s*)([\w.]+):(\S.*)$", self._text(line))
        if entry:
            fact = f"a space is missing after the colon. Write {entry[2]}: {_without_comment(entry[3])}."
            return line, entry.end(2), fact
        word = _without_comment(self._text(line))
        return line, self.begin[1], f"{word} has no colon; a name ends with one. Write {word}:"

    def _after_quote(self) -> Fault | None:
        if "block end" not in self.problem or "<scalar>" not in self.problem:
            return None
        return (
            self.line,
            self.column,
            "text goes on after a closing quote. Put all of it in quotes, and write ' twice within '…'.",
        )

    def _documents(self) -> Fault | None:
        if "another document" in self.problem:
            return self.line, self.column, "--- begins a second file in YAML; a shot is one. Remove it."
        if "<document start>" in self.problem:
            fact = "the lines above are indented and this one is not. Begin all names in one column."
            return self.line, self.column, fact
        return None


def quoted(text: str) -> str:
    """Return text in quotes of YAML: single ones where that works without doubling."""
    text = text.strip()
    return f'"{text}"' if "'" in text and '"' not in text else "'" + text.replace("'", "''") + "'"


def _indent(spaces: int) -> str:
    if not spaces:
        return "Do not indent it."
    return f"Indent it by {spaces} space{'s' if spaces > 1 else ''}."


def _without_comment(text: str) -> str:
    return re.sub(r"(^|\s)#.*$", "", text).strip()
