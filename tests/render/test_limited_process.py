"""Parsers in a process of their own: what crashes, hangs or fills the memory there is an error here."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from flowsculpt.render.base import limited_process
from flowsculpt.render.base.limited_process import Parser, ParserError

PARSERS = {
    "crashes": ("os.abort()", "its reader crashed or ran out of memory"),
    "refuses": ("raise ValueError('no\\nheader')", "no header"),
    "floods": ("bytes(8 << 30)", "its reader needed too much memory"),
    "writes": ("(Path(path).parent / 'b').write_text('x' * 9)", "File too large"),
    "hangs": ("time.sleep(30)", "its reader took over 2 seconds"),
}


def parser(folder: Path, name: str, statement: str) -> Path:
    """Write a module that runs a statement for a file; return the file."""
    (folder / f"{name}.py").write_text(
        "import os, time\nfrom pathlib import Path\n"
        "from flowsculpt.render.base.limited_process import Parser\n"
        f"def parse(path):\n    print('noise')\n    {statement}\n    return Path(path).read_bytes()\n"
        "Parser.serve(parse)\n"
    )
    (folder / "file").write_bytes(b"content")
    return folder / "file"


@pytest.mark.slow
@pytest.mark.parametrize("name", PARSERS)
def test_what_a_parser_does_to_its_process_is_told_as_an_error(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if name == "floods" and sys.platform != "linux":
        pytest.skip("only Linux limits memory")
    statement, fact = PARSERS[name]
    monkeypatch.syspath_prepend(tmp_path)
    if name == "hangs":
        monkeypatch.setattr(limited_process, "SECONDS", 2.0)
    with pytest.raises(ParserError, match=fact):
        Parser(name).answer(parser(tmp_path, name, statement))
    assert not (tmp_path / "b").exists() or (tmp_path / "b").stat().st_size == 0


def test_a_parser_answers_whatever_its_library_prints(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    assert Parser("answers").answer(parser(tmp_path, "answers", "pass")) == b"content"
