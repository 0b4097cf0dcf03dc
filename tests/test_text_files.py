"""Text files are UTF-8 whatever the locale: `open` and the like name the encoding."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]


def without_encoding(file: Path) -> Iterator[str]:
    """Yield the places where a module reads or writes text in the encoding of the locale."""
    source = file.read_text(encoding="utf-8")
    for call in ast.walk(ast.parse(source)) if "_text(" in source else ():
        if not (isinstance(call, ast.Call) and isinstance(call.func, ast.Attribute)):
            continue
        named = {keyword.arg for keyword in call.keywords}
        is_text = call.func.attr == "write_text" or (call.func.attr == "read_text" and not call.args)
        if is_text and "encoding" not in named:
            yield f"{file.relative_to(ROOT)}:{call.lineno}"


def test_every_text_file_is_read_and_written_as_utf_8():
    files = [*(ROOT / "pipeline").rglob("*.py"), *(ROOT / "render").rglob("*.py")]
    assert len(files) > 300
    assert [place for file in files for place in without_encoding(file)] == []
