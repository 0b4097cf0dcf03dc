"""Formulas compile_formulas: they are what numpy says, and nothing is compile_formulas twice."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, reject, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.formula import Expression, FormulaError
from flowsculpt.pipeline.plugins.fields.compiled_formulas import NAMES, compile_formulas, source

NAMES = (*NAMES, "k")
PLACES = np.array([[-1.5, 0.0, 0.5, 2.0], [3.0, 1.0, -2.0, 0.25], [0.0, -0.5, 1.0, 7.0]])


def by_block(texts: tuple[str, str, str], time: float = 0.75, k: float = 3.0) -> np.ndarray:
    u, v, w = (Expression(text, NAMES) for text in texts)
    out = np.zeros_like(PLACES)
    compile_formulas((u, v, w), ("k",))(np.array([k]), PLACES, time, out)
    return out


def by_numpy(text: str, time: float = 0.75, k: float = 3.0) -> np.ndarray:
    x, y, z = PLACES
    with np.errstate(all="ignore"):
        return Expression(text, NAMES)(x=x, y=y, z=z, t=time, k=k)


EVERYTHING = (
    ("-x + +y", "x % 1 - y % -0.75", "(x - 1) ** 3 + 2 ** x + 4 ** -1"),
    ("min(x, y, z) + max(x, y, k)", "clamp(x, -1, 1) * abs(y)", "smoothstep(0, 2, x) + floor(y) - ceil(z)"),
    ("1 if x < 0 else 2 if y > 1 else t", "(0 <= x < 2) + (y != 1) - (x == 2)", "not x > 0 and y or z"),
    ("sin(x) + cos(y) + tan(z)", "asin(x / 9) + acos(y / 9) + atan(z)", "atan2(y, x) + pi - e"),
    ("sqrt(abs(x)) + exp(-y)", "log(abs(x) + 1)", "k * sin(t) + k ** 2"),
)


@pytest.mark.parametrize("texts", EVERYTHING, ids=[" | ".join(texts) for texts in EVERYTHING])
def test_every_word_means_the_same_compiled(texts: tuple[str, str, str]) -> None:
    for row, text in zip(by_block(texts), texts, strict=True):
        np.testing.assert_allclose(row, by_numpy(text), rtol=1e-14, atol=1e-15)


def test_a_block_adds_to_what_is_there() -> None:
    block = compile_formulas(tuple(Expression(text, NAMES) for text in ("x", "y", "z")), ("k",))  # type: ignore[arg-type]
    out = np.ones_like(PLACES)
    block(np.zeros(1), PLACES, 0.0, out)
    np.testing.assert_array_equal(out, PLACES + 1.0)


LEAVES = st.one_of(st.sampled_from(["x", "y", "z", "t", "k", "pi"]), st.floats(0.1, 9).map("{:.3f}".format))
FORMULAS = st.recursive(
    LEAVES,
    lambda part: st.one_of(
        st.tuples(part, st.sampled_from(["+", "-", "*", "<", ">=", "/", "**"]), part).map(
            lambda p: f"({p[0]} {p[1]} {p[2]})"
        ),
        part.map(lambda p: f"sqrt(sin({p}))"),
        st.tuples(part, part, part).map(lambda p: f"({p[0]} if {p[1]} else min({p[2]}, {p[0]}))"),
    ),
    max_leaves=10,
)


@settings(max_examples=8, deadline=None)
@given(st.tuples(FORMULAS, FORMULAS, FORMULAS))
def test_any_formulas_are_what_numpy_makes_of_them(texts: tuple[str, str, str]) -> None:
    try:
        found = by_block(texts)
    except FormulaError:  # a part of it is never finite
        reject()
    for row, text in zip(found, texts, strict=True):
        try:
            wanted = by_numpy(text)
        except UsageError:
            assert not np.isfinite(row).all()
        else:
            np.testing.assert_allclose(row, wanted, rtol=1e-9, atol=1e-12)


def test_what_two_formulas_share_is_computed_once() -> None:
    shared = "exp(-(x ** 2 + y ** 2))"
    u, v, w = (Expression(f"{factor} * {shared}", NAMES) for factor in ("x", "y", "sin(t)"))
    text = source((u, v, w))
    assert text.count("math.exp") == 1
    assert text.index("math.sin") < text.index("for i in range"), "what no point changes is not in the loop"


ONCE = """
from flowsculpt.pipeline.formula import Expression
from flowsculpt.pipeline.plugins.fields.compiled_formulas import NAMES, compile_formulas
block = compile_formulas(tuple(Expression(text, NAMES) for text in {texts!r}))
block.address
again = compile_formulas(tuple(Expression(text, NAMES) for text in {texts!r}))
print(block._compiled.cache_hits, again is block)
"""


@pytest.mark.slow
def test_a_new_formula_is_compiled_once_and_then_found(tmp_path) -> None:
    texts = ("-y * exp(-(x ** 2 + y ** 2))", "x * 1.625", "0.3 * sin(t)")
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    for expected_hits in (0, 1):
        done = subprocess.run(
            [sys.executable, "-c", ONCE.format(texts=texts)], env=environment, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
        assert done.stdout.split() == [str(expected_hits), "True"]


def test_trouble_is_told_with_its_column_and_the_place() -> None:
    values = {"x": 0.0, "y": 2.0, "z": 0.0, "t": 0.5, "k": 1.0}
    told = Expression("y + 1 / x", NAMES).diagnose(values)
    assert told is not None and "column 5: 1 / x is inf at x 0, y 2" in told
    told = Expression("  é * sqrt(x - 1)", ("é", "x")).diagnose({"é": 2.0, "x": 0.0})
    assert told is not None and "column 7: sqrt(x - 1) is nan" in told
    assert Expression("1 / x if x else y", NAMES).diagnose(values) is None
    assert Expression("y", NAMES).diagnose(values) is None
