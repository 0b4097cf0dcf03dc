"""Messages about text that is not YAML."""

from __future__ import annotations

import re

from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.reader import ReaderError

HEX_COLOUR = re.compile(r"#(?:[0-9a-fA-F]{3}){1,2}(?![0-9a-zA-Z])")
"""A colour as web pages have it. Outside of quotes YAML takes it as a comment."""

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
    lines = [line[:_MOST_CHARACTERS] for line in [*text.splitlines(), ""]]
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
    for number in {min(line, len(lines) - 1), max(min(line, len(lines)) - 1, 0)}:
        indent = re.match(r"\s*", lines[number])
        if indent and "\t" in indent[0]:
            return number, indent[0].index("\t"), "a tab indents this line; YAML takes spaces only"
    if context and "end of stream" in problem:
        return *begin, f"this quote is never closed; write {quoted(lines[begin[0]][begin[1] + 1 :])}"
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
    comment = re.search(r"\s(#.*)$", text)
    if comment and (colour := HEX_COLOUR.match(comment[1])):
        message = f"# begins a comment in YAML; put the colour in quotes: '{colour[0]}'"
        return begin[0], begin[1] + comment.start(1), message
    if line > begin[0] or re.search(r"(?:found|got) '[]}]'", problem):
        return *begin, f"this {text[:1]} is never closed; add {'}' if text[:1] == '{' else ']'}"
    words = re.search(r"([\w.]+)\s*$", lines[line][:column])
    return line, column, f"a comma is missing before {words[1] if words else 'this'}"


def quoted(text: str) -> str:
    """Return text in quotes of YAML: single ones where that works without doubling."""
    text = text.strip()
    return f'"{text}"' if "'" in text and '"' not in text else "'" + text.replace("'", "''") + "'"
