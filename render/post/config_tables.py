"""The tables of colours that an OpenColorIO config names: files that decide its colours besides its own."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from pathlib import Path

from flowsculpt.render.base.file_contents import as_utf8
from flowsculpt.render.base.input_files import InputFile
from flowsculpt.render.base.render_errors import BadInputError

MOST_CONFIG = 64 << 20
"""Size of the largest config, and of the largest table that may refer to others."""

_SOURCE = re.compile(r"\bsrc\s*:\s*([^,}\n]+)")
_SEARCH_PATH = re.compile(r"^search_path\s*:[ \t]*(\[[^\]]*\]|\S.*|(?:\n[ \t]*-.*)+)", re.MULTILINE)
_ENVIRONMENT = re.compile(r"^environment\s*:[ \t]*(\{[^}]*\}|(?:\n[ \t]+\S.*)+)", re.MULTILINE)
_DEFAULT = re.compile(r"(\w+)\s*:\s*([^,}\n]*)")
_VARIABLE = re.compile(r"\$\{(\w+)\}|\$(\w+)|%(\w+)%")
_REFERENCE = re.compile(r"<Reference\b[^>]*\b(?:path|basePath)\s*=\s*[\"']([^\"']+)")
_REFERRING = (".ctf", ".clf")

_TEXT_TABLES = (".3dl", ".csp", ".cube", ".itx", ".lut", ".spi1d", ".spi3d")
_DECIMAL_COMMA = re.compile(rb"^[ \t]*([-+]?\d+,\d+)", re.MULTILINE)


def tables(config: Path) -> list[Path]:
    """Return the tables that a config names: where OpenColorIO finds them, and all of that name below it.

    Variables in names have the values of the environment, or those that the config gives them. Raises
    MissingInputError and BadInputError where the config or a table cannot be read.
    """
    if config.suffix != ".ocio":
        return []  # an archive, .ocioz, holds its tables
    text = _text(config)
    sources = [source.strip().strip("'\"") for source in _SOURCE.findall(text)]
    names = {Path(source).name for source in sources}
    below = {
        file for file in (config.parent.rglob("*") if names else ()) if file.name in names and file.is_file()
    }
    variables = _variables(text)
    folders = [config.parent / _expanded(folder, variables) for folder in _search_path(text) or [""]]
    known = {file.resolve() for file in below}
    named = (_first(folders, _expanded(source, variables)) for source in sources)
    found = below | {file for file in named if file is not None and file.resolve() not in known}
    referring = [file for file in found if file.suffix.lower() in _REFERRING]
    while referring:
        table = referring.pop()
        for name in _REFERENCE.findall(_text(table)):
            other = _first([table.parent, *folders], _expanded(name, variables))
            if other is not None and other not in found:
                found.add(other)
                referring += [other] if other.suffix.lower() in _REFERRING else []
    for table in sorted(found):
        _require_plain(table)
    return sorted(found)


def _text(path: Path) -> str:
    content = InputFile(path, MOST_CONFIG).content()
    try:
        return as_utf8(content).decode("utf-8", "replace")
    except ValueError as error:
        raise BadInputError(f"{path}: {error}. Save it as UTF-8.") from None


def _require_plain(table: Path) -> None:
    """Refuse a table of colours that OpenColorIO would not read, or would read wrong."""
    if table.suffix.lower() not in _TEXT_TABLES:
        return
    content = InputFile(table, MOST_CONFIG).content()
    try:
        is_plain = as_utf8(content) == content and (b"\n" in content or b"\r" not in content)
    except ValueError:
        is_plain = False
    if not is_plain:
        fact = "it is UTF-16, has a byte order mark or lines that end in CR, which OpenColorIO does not read"
        raise BadInputError(f"{table}: {fact}. Save it as plain text.")
    comma = _DECIMAL_COMMA.search(content)
    if comma:
        line = content.count(b"\n", 0, comma.start(1)) + 1
        raise BadInputError(
            f"{table}: line {line}: {comma[1].decode()} is not a number; decimals have a point"
        )


def _search_path(text: str) -> list[str]:
    """Return the folders of the key `search_path`: a list, or text with colons."""
    found = _SEARCH_PATH.search(text)
    if found is None:
        return []
    value = found[1].strip()
    listed = value[:1] in ("[", "-")
    parts = re.split(r"[\n,]", value.strip("[]")) if listed else value.strip("'\"").split(":")
    return [part.strip().removeprefix("- ").strip().strip("'\"") for part in parts]


def _variables(text: str) -> dict[str, str]:
    found = _ENVIRONMENT.search(text)
    given = {name: value.strip().strip("'\"") for name, value in _DEFAULT.findall(found[1] if found else "")}
    return given | dict(os.environ)


def _expanded(name: str, variables: dict[str, str]) -> str:
    """Return a name with the values of its variables, which may hold others."""
    for _ in range(8):
        after = _VARIABLE.sub(lambda part: variables.get(part[1] or part[2] or part[3], part[0]), name)
        if after == name:
            break
        name = after
    return name


def _first(folders: Iterable[Path], name: str) -> Path | None:
    try:
        return next((place for folder in folders if (place := folder / name).is_file()), None)
    except (OSError, ValueError):  # a name that no file can have
        return None
