"""Parsers in a process of their own: what crashes, hangs or fills the memory there is an error here."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path

import pytest

from flowsculpt.render.base import limited_process
from flowsculpt.render.base.limited_process import Parser, ParserError
from flowsculpt.render.base.python_process import ForkedProcess

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


ECHO = """
from flowsculpt.render.base.limited_process import Parser
Parser.serve_session(lambda path: lambda question: question.encode() * 50_000)
"""


def test_forked_processes_get_the_answers_to_their_own_questions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "echo.py").write_text(ECHO)
    (tmp_path / "file").write_bytes(b"content")
    monkeypatch.syspath_prepend(tmp_path)
    session = Parser("echo").session(tmp_path / "file")
    assert session.ask("a") == b"a" * 50_000

    def ask(word: str) -> int:
        return sum(session.ask(word) != word.encode() * 50_000 for _ in range(1000))

    forked = [ForkedProcess(partial(ask, word)) for word in "bc"]
    assert [process.wait() for process in forked] == [0, 0]
    assert ask("a") == 0


def test_a_session_answers_one_question_after_another_and_ends_where_its_parser_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "several.py").write_text(
        "import os, time\nfrom pathlib import Path\n"
        "from flowsculpt.render.base.limited_process import Parser\n"
        "def begin(path, word):\n    print('noise')\n    content = Path(path).read_bytes()\n"
        "    def answer(question):\n"
        "        if question == 'crash': os.abort()\n"
        "        if question == 'hang': time.sleep(30)\n"
        "        if question == 'refuse': raise ValueError('no header')\n"
        "        return content + word.encode() + question.encode()\n"
        "    return answer\n"
        "Parser.serve_session(begin)\n"
    )
    (tmp_path / "file").write_bytes(b"content")
    monkeypatch.syspath_prepend(tmp_path)
    session = Parser("several").session(tmp_path / "file", "-")
    assert [session.ask(word) for word in ("a", "b" * 100_000)] == [
        b"content-a",
        b"content-" + b"b" * 100_000,
    ]
    with pytest.raises(ParserError, match="no header"):
        session.ask("refuse")
    with pytest.raises(ParserError, match="its reader crashed or ran out of memory"):
        Parser("several").session(tmp_path / "file", "-").ask("crash")
    monkeypatch.setattr(limited_process, "SECONDS", 3.0)
    with pytest.raises(ParserError, match="its reader took over 3 seconds"):
        Parser("several").session(tmp_path / "file", "-").ask("hang")
