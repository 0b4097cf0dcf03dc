"""Files beside shots: whether they are there, which are edits, and names in messages."""

from __future__ import annotations

import re
from pathlib import Path

from flowsculpt.pipeline.errors import MissingInputError, ShotError, quote
from flowsculpt.pipeline.plugin import plugins
from flowsculpt.render.base.file_contents import as_utf8
from flowsculpt.render.base.input_files import InputFile
from flowsculpt.render.base.plural import indefinite
from flowsculpt.render.base.render_errors import BadInputError

DEFAULTS = "defaults.yaml"
"""The file beside shots that holds defaults for all of them."""

MOST_BYTES = 300_000
"""Size of the largest shot file or edit that is read; its parser takes some seconds for as much."""

NAME_PATTERN = r"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}"
"""The pattern of names of shots and edits: they become part of file names, on any system.

File systems allow some 250 letters with the numbers and suffixes of files.
"""

_TOO_LARGE = (
    f"the file is larger than {MOST_BYTES // 1000} kB; a shot file has a few. Put points and samples in "
    "files of their own."
)

_EDIT, _SHOT = re.compile(r"^shots\s*:", re.MULTILINE), re.compile(r"^(subjects?|extends)\s*:", re.MULTILINE)


def is_folder(path: Path) -> bool:
    """Tell whether a path names a folder; a name too long for one does not."""
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


def shot_files(folder: Path) -> list[Path]:
    """Return the files of shots and edits of a folder, sorted. Hidden ones are of other programs."""
    return sorted(file for file in folder.glob("[!.]*.yaml") if file.name != DEFAULTS)


def name_fault(name: str, kind: str = "shot") -> str | None:
    """Return rule and remedy for a name that a shot or an edit cannot have; None for a good one."""
    example = "showreel" if kind == "edit" else "A010_cube"
    if name.lower() == Path(DEFAULTS).stem:
        return f"{name} is the name of the file of defaults in shots/; choose another one, as A010_{name}"
    of_plugins = {command.folder for command in plugins().commands.values()}
    if name.lower() in {"edit", "film", *of_plugins} and not (kind == "edit" and name == "film"):
        return f"{name} is the name of a folder in renders/; choose another one, as A010_{name}"
    if not re.fullmatch(NAME_PATTERN, name):
        rule = f"use letters, digits, _ and -, as in {example}"
        return f"{quote(name)} cannot name {indefinite(kind)}; {rule}"
    return None


def text_of(path: Path) -> str:
    """Return the text of a shot file or an edit.

    It may be UTF-8, or UTF-16 and UTF-32 as `as_utf8` knows them. Raises MissingInputError where no regular
    file can be read, ShotError for other text and for files over MOST_BYTES.
    """
    try:
        content = InputFile(path, MOST_BYTES).content()
    except BadInputError:
        raise ShotError(f"{path}:1:1: {_TOO_LARGE}") from None
    try:
        return as_utf8(content).decode("utf-8").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as error:
        raise ShotError(
            f"{path}:1:1: byte {error.start} is not UTF-8; a shot file is plain text. Save it as UTF-8."
        ) from None
    except ValueError as error:
        raise ShotError(f"{path}:1:1: {error}. Save it as UTF-8.") from None


def is_edit(path: Path) -> bool:
    """Tell whether a file is an edit: it lists shots and has no subject. Works on broken YAML too.

    False for a file that cannot be read; whoever reads it reports why.
    """
    try:
        text = text_of(path)
    except (MissingInputError, ShotError):
        return False
    return bool(_EDIT.search(text)) and not _SHOT.search(text)


def quote_name(name: str | Path) -> str:
    """Return a name for a message: at most 200 characters, and printable."""
    text = str(name) if str(name).isprintable() else repr(str(name))
    return text if len(text) <= 200 else f"{text[:100]}…{text[-40:]}"
