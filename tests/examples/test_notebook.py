"""The notebook of the library: its cells run in a process of their own, and print what is stored."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

NOTEBOOK = Path(__file__).parents[2] / "examples" / "resampling.ipynb"

RUN = """
import contextlib, io, json, sys

names, printed = {"__name__": "__main__"}, []
for source in json.load(sys.stdin):
    with contextlib.redirect_stdout(io.StringIO()) as out:
        exec(compile(source, "notebook", "exec"), names)
    printed.append(out.getvalue())
json.dump([printed, len(names["plt"].get_fignums())], sys.stdout)
"""


def _cells() -> list[dict[str, Any]]:
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    return [cell for cell in cells if cell["cell_type"] == "code"]


def _source(cell: dict[str, Any]) -> str:
    return "".join(cell["source"])


@pytest.mark.slow
def test_the_notebook_runs_from_top_to_bottom_and_prints_what_it_shows(tmp_path: Path) -> None:
    cells = _cells()
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", RUN],
        input=json.dumps([*map(_source, cells)]),
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "MPLBACKEND": "agg", "MPLCONFIGDIR": str(tmp_path)},
        timeout=300,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    printed, pictures = json.loads(done.stdout)
    for cell, text in zip(cells, printed, strict=True):
        if "pyvista" not in _source(cell) or text:  # it has no wheel small enough for the tests
            assert "".join("".join(o["text"]) for o in cell["outputs"] if "text" in o) == text
    assert pictures == sum("image/png" in o.get("data", {}) for cell in cells for o in cell["outputs"])


def test_the_stored_notebook_is_whole_and_small() -> None:
    cells = _cells()
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    assert {o["output_type"] for cell in cells for o in cell["outputs"]} == {"stream", "display_data"}
    assert any("pyvista" in _source(cell) and cell["outputs"] for cell in cells)
    assert NOTEBOOK.stat().st_size < 300_000
