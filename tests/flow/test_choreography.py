"""Keys, easing, and parameters between frames."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.flow import EASINGS, Keyframes, keyed
from pipeline.flow.choreography import number_at, place_at

smooth = sorted(set(EASINGS) - {"constant"})


@pytest.mark.parametrize("name", smooth)
def test_every_easing_starts_at_one_key_and_ends_at_the_other(name: str) -> None:
    assert EASINGS[name](0.0) == pytest.approx(0.0, abs=1e-12)
    assert EASINGS[name](1.0) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("name", [name for name in smooth if not name.startswith("back")])
def test_every_easing_but_back_only_rises(name: str) -> None:
    values = [EASINGS[name](i / 200) for i in range(201)]
    assert all(a <= b + 1e-15 for a, b in pairwise(values))


@pytest.mark.parametrize("family", ["sine", "quad", "cubic", "quart", "quint", "expo", "circ", "back"])
@given(s=st.floats(0, 1))
def test_out_is_in_turned_round_and_in_out_is_symmetric(family: str, s: float) -> None:
    assert EASINGS[f"{family}_out"](s) == pytest.approx(1 - EASINGS[f"{family}_in"](1 - s), abs=1e-12)
    both = EASINGS[f"{family}_in_out"]
    assert both(s) == pytest.approx(1 - both(1 - s), abs=1e-12)


def test_in_starts_slowly_and_out_ends_slowly() -> None:
    assert EASINGS["cubic_in"](0.5) == 0.125
    assert EASINGS["cubic_out"](0.5) == 0.875
    assert EASINGS["cubic_in_out"](0.5) == 0.5


def test_a_value_holds_before_the_first_key_and_after_the_last() -> None:
    keys = keyed((1.0, 2.0), (5.0, 7.0), "linear")
    assert [number_at(keys, t) for t in (0.0, 1.0, 1.25, 2.0, 9.0)] == [5.0, 5.0, 5.5, 7.0, 7.0]


def test_a_constant_easing_jumps_at_the_next_key_even_if_a_sum_of_steps_just_misses_it() -> None:
    keys = keyed((0.0, 0.5), (1.0, 2.0), "constant")
    assert number_at(keys, 0.499) == 1.0
    assert number_at(keys, 0.5 - 1e-15) == 2.0


def test_every_key_may_have_an_easing_of_its_own() -> None:
    keys = Keyframes((0.0, 1.0, 2.0), ((0.0,), (4.0,), (8.0,)), ("constant", "linear", "linear"))
    assert number_at(keys, 0.9) == 0.0
    assert number_at(keys, 1.5) == 6.0


def test_vectors_are_keyed_as_numbers_are() -> None:
    keys = keyed((0.0, 1.0), ((0.0, 0.0, 0.0), (2.0, 4.0, -6.0)), "linear")
    assert place_at(keys, 0.5) == (1.0, 2.0, -3.0)


def test_a_constant_is_itself_at_any_time() -> None:
    assert number_at(3.5, 17.0) == 3.5
    assert place_at((1.0, 2.0, 3.0), 17.0) == (1.0, 2.0, 3.0)
