"""Ancestors and their shares, against a slow twin in fractions."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.arrays import AnyArray
from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.mesh.halfedge_mesh import Ancestry, ancestry


@st.composite
def families(draw: st.DrawFn) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Draw the present vertices, the former ones, and the births between; many of these have died again."""
    first, many = draw(st.integers(2, 12)), draw(st.integers(0, 40))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    then = rng.permutation(np.arange(100, 100 + first) * 3)
    everybody, births = then.tolist(), []
    for i in range(many):
        parents = rng.choice(len(everybody) - max(0, len(everybody) - 8), 2, replace=False)
        births.append([1000 + i, *(everybody[-1 - p] for p in parents)])
        everybody.append(1000 + i)
    now = rng.permutation(everybody)[: draw(st.integers(0, len(everybody)))]
    return now, then, np.array(births, np.int64).reshape(-1, 3)


def slow_shares(then: AnyArray, births: AnyArray) -> dict[int, dict[int, Fraction]]:
    """Return every vertex's shares of its ancestors: the mean of its parents' shares."""
    shares = {name: {name: Fraction(1)} for name in then.tolist()}
    for child, a, b in births.tolist():
        both = shares[a].keys() | shares[b].keys()
        shares[child] = {n: (shares[a].get(n, Fraction(0)) + shares[b].get(n, Fraction(0))) / 2 for n in both}
    return shares


def shares_of(found: Ancestry, vertex: int, then: AnyArray) -> dict[int, Fraction]:
    mine = found.heirs == vertex
    pairs = zip(then[found.ancestors[mine]].tolist(), found.weights[mine].tolist(), strict=True)
    return {name: Fraction(weight) for name, weight in pairs}


@settings(deadline=None)
@given(families())
def test_the_shares_are_those_of_the_family_tree_to_the_bit(family: tuple[AnyArray, ...]) -> None:
    now, then, births = family
    found = ancestry(now, then, births)
    expected = slow_shares(then, births)
    for vertex, name in enumerate(now.tolist()):
        assert shares_of(found, vertex, then) == expected[name]
        assert sum(expected[name].values()) == 1
    assert (np.diff(found.heirs * len(then) + found.ancestors) > 0).all(), "each pair once, in order"


@settings(deadline=None)
@given(families(), st.integers(0, 2**32 - 1))
def test_what_is_a_mean_at_every_birth_is_a_mean_of_the_ancestors(
    family: tuple[AnyArray, ...], seed: int
) -> None:
    now, then, births = family
    values = np.random.default_rng(seed).integers(-100, 100, (len(then), 2)).astype(float)
    had = dict(zip(then.tolist(), values, strict=True))
    for child, a, b in births.tolist():
        had[child] = 0.5 * (had[a] + had[b])
    found = ancestry(now, then, births)
    expected = np.array([had[name] for name in now.tolist()]).reshape(-1, 2)
    np.testing.assert_array_equal(found.mixed(values), expected)
    np.testing.assert_array_equal(found.mixed(values[:, 0]), expected[:, 0])
    np.testing.assert_array_equal(found.survives, np.isin(now, then))


@given(families(), st.integers(0, 40))
def test_from_then_to_now_is_from_then_to_between_and_on_to_now(
    family: tuple[AnyArray, ...], cut: int
) -> None:
    now, then, births = family
    between = np.concatenate([then, births[:cut, 0]])  # nobody has died yet
    values = np.arange(float(len(then))) ** 2
    halfway = ancestry(between, then, births[:cut]).mixed(values)
    two_steps = ancestry(now, between, births).mixed(halfway)
    np.testing.assert_array_equal(two_steps, ancestry(now, then, births).mixed(values))


def test_a_hundred_generations_are_no_more_than_their_ancestors() -> None:
    """Each is born of the two before it: shares tend to a third and two thirds."""
    births = np.array([[n, n - 1, n - 2] for n in range(2, 102)])
    found = ancestry(np.array([101]), np.array([0, 1]), births)
    np.testing.assert_allclose(found.weights, [1 / 3, 2 / 3], rtol=1e-15)


def test_births_that_are_missing_or_out_of_order_are_told() -> None:
    births = np.array([[2, 0, 1], [3, 2, 1]])
    with pytest.raises(UsageError, match=r"vertex 2 is neither of the earlier surface nor among the births"):
        ancestry(np.array([3]), np.array([0, 1]), births[1:])
    with pytest.raises(UsageError, match="births are not in order"):
        ancestry(np.array([3]), np.array([0, 1]), births[::-1])
