"""The notebook of the library: its cells run one after another, and print what is stored."""

from __future__ import annotations

import contextlib
import io
import json
from pathlib import Path
from typing import Any

import pytest

NOTEBOOK = Path(__file__).parents[2] / "examples" / "resampling.ipynb"


def _cells() -> list[dict[str, Any]]:
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    return [cell for cell in cells if cell["cell_type"] == "code"]


def _source(cell: dict[str, Any]) -> str:
    return "".join(cell["source"])


@pytest.mark.slow
def test_the_notebook_runs_from_top_to_bottom_and_prints_what_it_shows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLCONFIGDIR", str(tmp_path))
    import matplotlib.pyplot as plt

    plt.close("all")
    plt.switch_backend("agg")
    cells, names = _cells(), {"__name__": "notebook"}
    for cell in cells:
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            exec(compile(_source(cell), "notebook", "exec"), names)
        if "pyvista" not in _source(cell) or printed.getvalue():  # it has no wheel small enough for the tests
            shown = "".join("".join(o["text"]) for o in cell["outputs"] if "text" in o)
            assert shown == printed.getvalue()
    pictures = len(plt.get_fignums())
    plt.close("all")
    assert pictures == sum("image/png" in o.get("data", {}) for cell in cells for o in cell["outputs"])


def test_the_stored_notebook_is_whole_and_small() -> None:
    cells = _cells()
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    assert {o["output_type"] for cell in cells for o in cell["outputs"]} == {"stream", "display_data"}
    assert any("pyvista" in _source(cell) and cell["outputs"] for cell in cells)
    assert NOTEBOOK.stat().st_size < 300_000
