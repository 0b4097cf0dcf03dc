"""Formulas: what they compute, and that nothing else can be said in them."""

from __future__ import annotations

import ast
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.formula import (
    FUNCTIONS,
    MOST_CHARACTERS,
    PLACE,
    TIME,
    Expression,
    FormulaError,
    time_values,
)

NAMES = ("x", "y", "z", "time")
X, Y = np.array([-1.5, 0.0, 0.5, 2.0]), np.array([3.0, 1.0, -2.0, 0.25])


def value(text: str) -> np.ndarray:
    return Expression(text, NAMES)(x=X, y=Y, z=0.0, time=2.0)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0.02 + 0.01 * abs(y)", 0.02 + 0.01 * np.abs(Y)),
        ("-x ** 2", -(X**2)),
        ("2 ** -1", np.full(4, 0.5)),
        ("x % 1", X % 1),
        ("min(x, y, 0)", np.minimum(np.minimum(X, Y), 0)),
        ("clamp(x, 0, 1)", np.clip(X, 0, 1)),
        ("smoothstep(0, 2, x)", [0, 0, 0.15625, 1]),
        ("1 if x < 0 else 2", [1, 2, 2, 2]),
        ("0 <= x < 2", [0, 1, 1, 0]),
        ("(x < 0) - (y > 0)", [0, -1, 0, -1]),
        ("x > 0 and not y > 0 or x == 2", [0, 0, 1, 1]),
        ("sin(pi / 2) + cos(0) + log(e) + time", np.full(4, 5.0)),
        ("atan2(y, x)", np.arctan2(Y, X)),
        ("sqrt(x) if x >= 0 else 0", np.sqrt(np.maximum(X, 0))),
        ("floor(x) + ceil(x)", np.floor(X) + np.ceil(X)),
        ("  x\n + 1", X + 1),
    ],
)
def test_a_formula_is_what_it_says(text: str, expected: np.ndarray) -> None:
    np.testing.assert_allclose(value(text), expected, rtol=1e-14)


REFUSED = [
    ("sinn(x)", 1, "sinn is not a function here. Did you mean 'sin'?"),
    ("0.1 + tim", 7, "tim is not known here. Did you mean 'time'?"),
    ("x.real", 1, "Names have no parts"),
    ("().__class__", 1, "a point cannot stand here"),
    ("__import__('os')", 1, "__import__ is not a function here"),
    ("x if y else open('a')", 13, "open is not a function here"),
    ("abs(x)(y)", 1, "only functions by their name"),
    ("[x for x in y]", 1, "cannot stand in a formula"),
    ("x[0]", 1, "cannot stand in a formula"),
    ("lambda: x", 1, "cannot stand in a formula"),
    ("(x := 3)", 2, "cannot stand in a formula"),
    ("f'{x}'", 1, "cannot stand in a formula"),
    ("x and 'a'", 7, "is not a number"),
    ("True", 1, "is not a number"),
    ("2j", 1, "is not a number"),
    ("1e999", 1, "too large"),
    ("x ** 1e9", 6, "the exponent is too large; 64 is the largest"),
    ("x ** -1000", 7, "the exponent is too large"),
    ("x ^ 2", 1, "A power is written x ** 2"),
    ("x // 2", 1, "Write floor(a / b)"),
    ("x in y", 1, "this operator is not known here"),
    ("x +", 4, "this is not arithmetic"),
    ("x y", 3, "an operator is missing"),
    ("", 1, "it is empty"),
    ("sin", 1, "sin is a function; write sin(…)"),
    ("min(x)", 1, "min takes 2 or more arguments, not 1"),
    ("sin(x, y)", 1, "sin takes 1 argument, not 2"),
    ("clamp(x, high=1, low=0)", 1, "plain arguments"),
    ("max(*x)", 1, "plain arguments"),
    ("  é + 1", 3, "é is not known here"),
]


@pytest.mark.parametrize(("text", "column", "says"), REFUSED, ids=[text for text, _, _ in REFUSED])
def test_what_is_no_formula_is_told_with_its_column(text: str, column: int, says: str) -> None:
    with pytest.raises(FormulaError) as told:
        Expression(text, NAMES)
    assert (told.value.column, says in told.value.message) == (column, True), told.value
    assert f"column {column}: " in str(told.value)


def test_columns_count_characters_whatever_their_size() -> None:
    with pytest.raises(FormulaError, match="column 9: q is not known"):
        Expression("1 + é + q", ("é",))


@pytest.mark.parametrize(
    "text", ["-" * 60 + "x", "(" * 300 + "x" + ")" * 300, "x+" * 400 + "x", "x" * (MOST_CHARACTERS + 1), "\0"]
)
def test_a_formula_that_could_exhaust_the_machine_is_refused(text: str) -> None:
    with pytest.raises(FormulaError):
        Expression(text, NAMES)


def test_what_is_not_finite_is_told_with_the_first_place() -> None:
    with pytest.raises(UsageError, match=r"'1 / x' is inf at x 0, y 1, z 0, time 2; it must be finite"):
        value("1 / x")
    with pytest.raises(UsageError, match=r"is nan at x -1\.5, y 3"):
        value("sqrt(x)")
    with pytest.raises(UsageError, match="is inf"):
        value("9 ** 9 ** 9")


def test_a_formula_knows_what_it_speaks_of() -> None:
    assert Expression("x + pi * sin(time)", NAMES).uses == {"x", "time"}
    assert Expression("1", NAMES).uses == frozenset()


VOCABULARY = (
    "x y 2 0.5 pi sin min ( ) , + - * / ** % < == and not if else [ . __class__ ' lambda : = @ { } open "
    "import ; é \\ 0x1f 1_0 ... None \t"
)
WORDS = st.sampled_from(VOCABULARY.split(" "))


@settings(max_examples=400, deadline=None)
@given(st.lists(WORDS, min_size=1, max_size=14).map(" ".join))
def test_any_words_make_numbers_or_an_error_with_a_column(text: str) -> None:
    try:
        found = Expression(text, NAMES)
    except FormulaError as error:
        assert 1 <= error.column <= len(text) + 1
        return
    try:
        result = found(x=X, y=Y, z=0.0, time=1.0)
    except UsageError as error:
        assert "must be finite" in str(error)
    else:
        assert result.dtype == np.float64 and result.shape in ((), (4,)) and np.isfinite(result).all()


LEAVES = st.one_of(st.sampled_from(["x", "y", "pi"]), st.floats(0.1, 9).map(lambda v: f"{v:.3f}"))
SUMS = st.recursive(
    LEAVES,
    lambda part: st.one_of(
        st.tuples(part, st.sampled_from(["+", "-", "*", "<", ">="]), part).map(lambda t: f"({' '.join(t)})"),
        part.map(lambda p: f"abs(sin({p}))"),
        st.tuples(part, part, part).map(lambda t: f"({t[0]} if {t[1]} else {t[2]})"),
    ),
    max_leaves=12,
)


@given(SUMS)
def test_rows_are_what_python_computes_one_by_one(text: str) -> None:
    """The slow twin: the same text, by Python itself, for one point at a time."""
    tools = {"sin": math.sin, "abs": abs, "pi": math.pi, "__builtins__": {}}
    code = compile(ast.parse(text, mode="eval"), "formula", "eval")
    slow = [float(eval(code, tools, {"x": x, "y": y})) for x, y in zip(X.tolist(), Y.tolist(), strict=True)]
    np.testing.assert_allclose(value(text), slow, rtol=1e-12, atol=1e-12)


def test_every_function_takes_as_many_arguments_as_it_says() -> None:
    for name, (_, count) in FUNCTIONS.items():
        arguments = ", ".join(["0.5"] * (count - 1) + ["0.75"])
        assert Expression(f"{name}({arguments})", ())().shape == ()


def test_the_vocabulary_is_one() -> None:
    """`t` and `time` are the same wherever there are moments, and messages tell the one that is spoken of."""
    names = (*PLACE, *TIME)
    both = Expression("t - time + 1 / (frame - 3)", names)
    assert float(both(x=0, y=0, z=0, **time_values(5.0, 0.25))) == 0.5
    for text, says in (("1 / t", "t 0, frame 1;"), ("1 / time", "time 0, frame 1;")):
        with pytest.raises(UsageError, match=f"is inf at {says}"):
            Expression(text, TIME)(**time_values(1.0, 0.0))
    with pytest.raises(FormulaError, match=r"seconds is not known here\. Write t\."):
        Expression("seconds", TIME)
    with pytest.raises(FormulaError, match=r"tme is not known here\. Did you mean 'time'\?"):
        Expression("tme", TIME)
    with pytest.raises(FormulaError, match=r"t is not known here\. There are: x, y, z, pi"):
        Expression("t", PLACE)
