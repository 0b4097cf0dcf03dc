"""Docstrings on the API page: columns of parameters and sections of numpy's style become fields of Sphinx."""

from __future__ import annotations

import importlib.util
import inspect
import re
from pathlib import Path
from typing import Any

import pytest

SCRIPT = Path(__file__).parents[2] / "docs" / "public_names.py"


@pytest.fixture(scope="module")
def public_names() -> Any:
    spec: Any = importlib.util.spec_from_file_location("public_names", SCRIPT)
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    return script


def columns(size: float, edge: float = 0.1) -> None:
    """Return a box; `size` is 2 * edge at least.

    size        one number,
                or three
    edge        where `Resampler` cuts:
                long   in two
                short  never

    As in

        v = a_ | b
    """


def sections(size: float) -> None:
    """Return a box.

    Parameters
    ----------
    size
        One number.

    Raises
    ------
    MeshError
        Where it is empty.
    """


def formats(size: float) -> None:
    """Write a box.

    ply  binary
    obj  text
    """


@pytest.mark.parametrize(
    ("function", "shown"),
    [
        (
            columns,
            [":param size: one number,\n    or three", ":param edge: where :py:obj:`~flowsculpt.Resampler`"],
        ),
        (columns, ["    * ``long``: in two\n    * ``short``: never\n", "As in\n\n::\n\n    v = a_ | b"]),
        (columns, [r"``size`` is 2 \* edge"]),
        (sections, [":param size: One number.", ":raises MeshError: Where it is empty."]),
        (formats, ["* ``ply``: binary\n* ``obj``: text"]),
    ],
)
def test_a_docstring_is_shown_as_it_is_meant(public_names: Any, function: Any, shown: list[str]) -> None:
    lines = (inspect.getdoc(function) or "").split("\n")
    public_names.format_docstring(None, "function", function.__name__, function, None, lines)
    text = re.sub(r" +\n", "\n", "\n".join(lines))
    for part in shown:
        assert part in text


def test_a_signature_has_the_types_of_the_source(public_names: Any) -> None:
    arguments = public_names.write_signature(None, "function", "columns", columns, None, "()", None)
    assert arguments == ("(size: float, edge: float = 0.1)", "None")
