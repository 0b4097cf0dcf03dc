"""Standard streams that are closed, full, without a reader, or of an encoding that lacks characters."""

from __future__ import annotations

import codecs
import os
import subprocess
import sys
from io import StringIO
from pathlib import Path
from typing import IO

import pytest
from rich.console import Console

from flowsculpt.pipeline.cli.output import empty_table
from flowsculpt.render.base.python_process import python_command
from flowsculpt.render.base.standard_streams import LIKENESS, write_similar
from tests.conftest import new_project


@pytest.fixture(scope="module")
def show(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return new_project(tmp_path_factory.mktemp("show")).path


def in_shell(show: Path, line: str, environment: dict[str, str] | None = None) -> tuple[int, str]:
    """Run a line of the shell in which `fs` is the command; return the exit code and what it printed."""
    script = f'set -o pipefail; fs() {{ "{sys.executable}" -m flowsculpt "$@"; }}; {line}'
    words = ["bash", "-c", script]
    done = subprocess.run(words, cwd=show, env=environment, capture_output=True, text=True, timeout=120)
    return done.returncode, done.stdout + done.stderr


def forked(show: Path, *words: str, variables: dict[str, str], stdout: IO[bytes] | int) -> tuple[int, str]:
    """Run the command with some variables, as a fork where they allow it; return what it printed or said."""
    command = python_command("flowsculpt", "--no-progress", *words)
    environment = {**os.environ, **variables}
    done = subprocess.run(
        command, cwd=show, env=environment, stdout=stdout, stderr=subprocess.PIPE, timeout=120
    )
    return done.returncode, ((done.stdout or b"") + done.stderr).decode()


@pytest.mark.slow
@pytest.mark.parametrize("words", ["--version", "--help", "--dry-run --json simulate T010_tiny"])
def test_results_that_a_full_disk_refuses_are_one_line_and_exit_code_4(show: Path, words: str) -> None:
    with Path("/dev/full").open("wb") as full:
        code, told = forked(show, *words.split(), variables={}, stdout=full)
    assert code == 4 and told.startswith("standard output: cannot be written: the disk is full")
    assert told.count("\n") == 1


def test_results_for_a_closed_standard_output_are_one_line_and_exit_code_4(show: Path) -> None:
    code, told = in_shell(show, "fs --version >&-")
    assert code == 4 and told.startswith("standard output: cannot be written: it is closed")
    assert told.count("\n") == 1


def test_where_both_outputs_are_closed_the_exit_code_says_it(show: Path) -> None:
    assert in_shell(show, "fs --version >&- 2>&- <&-") == (4, "")


@pytest.mark.slow
@pytest.mark.parametrize("refusing", ["2>/dev/full", "2>&-"])
def test_messages_that_nobody_can_read_change_no_exit_code(show: Path, refusing: str) -> None:
    code, told = in_shell(show, f"fs simulate absent {refusing}")
    assert code == 3 and told == ""


@pytest.mark.slow
def test_in_ascii_a_table_has_its_columns_and_names_have_their_numbers(show: Path) -> None:
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    code, told = in_shell(show, "fs status T010_tiny; fs status 日本", environment)
    assert code == 2 and "T010_tiny  meshes  -     -      1-6" in told
    assert r"\u65e5\u672c" in told and "Traceback" not in told


@pytest.mark.parametrize(
    "encoding, written", [("latin-1", b"1 \xd7 2 - \xfc ..."), ("ascii", rb"1 x 2 - \xfc ...")]
)
def test_what_an_encoding_lacks_is_written_by_its_like(encoding: str, written: bytes) -> None:
    codecs.register_error(LIKENESS, write_similar)
    assert "1 × 2 – ü …".encode(encoding, LIKENESS) == written


@pytest.mark.slow
def test_python_that_strips_docstrings_runs_commands(show: Path) -> None:
    environment = {**os.environ, "PYTHONOPTIMIZE": "2", "PYTHONPYCACHEPREFIX": str(show / "compiled")}
    for words, said in (("status --help", "List which frames"), ("status T010_tiny", "meshes")):
        code, told = in_shell(show, f"fs {words}", environment)
        assert code == 0 and said in told


@pytest.mark.slow
def test_numba_that_may_not_compile_is_named(show: Path) -> None:
    code, told = in_shell(show, "NUMBA_DISABLE_JIT=1 fs simulate T010_tiny")
    assert code == 4 and told.startswith("NUMBA_DISABLE_JIT is set") and told.count("\n") == 1


@pytest.mark.slow
@pytest.mark.parametrize("variable", ["NUMPY_MADVISE_HUGEPAGE", "SOURCE_DATE_EPOCH", "TERMINAL_WIDTH"])
def test_variables_that_libraries_cannot_read_are_named(show: Path, variable: str) -> None:
    for value in ("abc", "9" * 20):
        code, told = in_shell(show, f"{variable}={value} fs flows --help")
        assert code == 4 and told.startswith(f"error: {variable} is '{value}'") and told.count("\n") == 1
    code, told = in_shell(show, f"{variable}= fs flows --help")
    assert code == 0 and "error" not in told


@pytest.mark.slow
@pytest.mark.parametrize("variables", [{}, {"COLUMNS": "30"}, {"COLUMNS": "0"}, {"FORCE_COLOR": "1"}])
def test_a_pipe_gets_tables_in_full(show: Path, variables: dict[str, str]) -> None:
    for words, told in (
        (["flows"], "Narrows a waist and drives its material out to both sides, like a gripp"),
        (["preview", "--help"], "flows.0.vortex.strength=2"),
    ):
        code, printed = forked(show, *words, variables=variables, stdout=subprocess.PIPE)
        assert code == 0 and told in printed


def test_on_a_narrow_terminal_names_are_wrapped_and_no_character_is_lost() -> None:
    narrow = Console(width=10, file=StringIO())
    rows = empty_table("shot", "done")
    rows.add_row("SHOT_0123456789", "12")
    narrow.print(rows)
    told = narrow.file.getvalue()
    assert "…" not in told and "".join(line[:4] for line in told.splitlines()).startswith("shotSHOT")
