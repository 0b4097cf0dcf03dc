"""Every figure has its script, its picture and its place in the docs."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from examples import corner_table, drawing
from examples.__main__ import FIGURES
from flowsculpt.pipeline.mesh import HalfedgeMesh

DOCS = drawing.PICTURES.parent


def test_every_script_is_drawn_and_told_of_in_the_docs() -> None:
    text = "".join(page.read_text() for page in DOCS.glob("*.md"))
    for name in FIGURES:
        assert re.search(rf"pictures/{name}\.(svg|png)", text), name


def test_every_picture_of_the_docs_is_there_and_small() -> None:
    for page in DOCS.glob("*.md"):
        for name in re.findall(r"\]\((pictures/[^)]+)\)", page.read_text()):
            most = 600_000 if name == "pictures/film.webp" else 300_000  # which moves
            assert 1_000 < (DOCS / name).stat().st_size < most, name


def test_a_figure_is_the_same_bytes_however_often_it_is_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(drawing, "PICTURES", tmp_path / "docs" / "pictures")
    drawing.PICTURES.mkdir(parents=True)
    drawn = []
    for _ in range(2):
        corner_table.draw()
        drawn.append((drawing.PICTURES / "corner_table.svg").read_bytes())
    assert drawn[0] == drawn[1]


def test_the_corner_table_that_is_drawn_keeps_its_invariants() -> None:
    table = HalfedgeMesh(corner_table.PATCH)
    h = np.flatnonzero(table.twins >= 0)
    following = np.where(h % 3 == 2, h - 2, h + 1)
    assert (table.twins[table.twins[h]] == h).all()
    assert (table.arrays.vert[table.twins[h]] == table.arrays.vert[following]).all()
