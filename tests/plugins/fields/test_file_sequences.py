"""Numbered files are read in the order of their numbers."""

from __future__ import annotations

from pathlib import Path

import pytest

from flowsculpt.pipeline.plugins.fields.file_sequences import files_named
from flowsculpt.pipeline.shot.yaml.document_validation import ParseContext


@pytest.mark.parametrize(
    ("names", "is_noted"),
    [
        ("v_1 v_2 v_10", False),
        ("v_8 v_09 v_010 v_11", False),
        ("v1_9 v1_10 v2_1", False),
        ("v_-10 v_-2 v_0 v_3", False),
        ("wind-1 wind-2 wind-10", False),
        ("2026-01-05 2026-01-31 2026-02-01", False),
        ("t_0.5 t_1.25 t_10.0", False),
        ("t_0.25 t_0.5 t_1", True),
        ("v1.10 v1.8 v1.9", True),
        ("v_01 v_1 v_2", True),
        ("v_0998 v_0999 v_1000", False),
    ],
)
def test_files_are_in_the_order_of_their_numbers_and_a_doubtful_order_is_noted(
    names: str, is_noted: bool, tmp_path: Path
) -> None:
    for name in names.split():
        (tmp_path / f"{name}.npz").touch()
    context = ParseContext(tmp_path)
    assert " ".join(path.stem for path in files_named("*.npz", context)) == names
    assert bool(context.notes) is is_noted
