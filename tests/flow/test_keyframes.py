"""Keys, easing, and parameters between frames."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flowsculpt.pipeline.flow import EASINGS, Keyframes, keyed
from flowsculpt.pipeline.flow.easings import HAND_EASES, easing, kinks
from flowsculpt.pipeline.flow.keyframes import FormulaCurve, Handle
from flowsculpt.pipeline.flow.parameters import number_at, vector_at

smooth = sorted(set(EASINGS) - {"constant"})
swinging = ("back", "bounce", "elastic")
returning = (*swinging, "drop", "settle")
FAMILIES = ["sine", "quad", "cubic", "quart", "quint", "expo", "circ", *swinging]


@pytest.mark.parametrize("name", smooth)
def test_every_easing_starts_at_one_key_and_ends_at_the_other(name: str) -> None:
    assert EASINGS[name](0.0) == pytest.approx(0.0, abs=1e-12)
    assert EASINGS[name](1.0) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize(
    "name", [name for name in smooth if not name.startswith((*swinging, "drop", "settle"))]
)
def test_every_easing_that_does_not_swing_only_rises(name: str) -> None:
    values = [EASINGS[name](i / 200) for i in range(201)]
    assert all(a <= b + 1e-15 for a, b in pairwise(values))


@pytest.mark.parametrize("family", FAMILIES)
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
    assert vector_at(keys, 0.5) == (1.0, 2.0, -3.0)


def test_a_constant_is_itself_at_any_time() -> None:
    assert number_at(3.5, 17.0) == 3.5
    assert vector_at((1.0, 2.0, 3.0), 17.0) == (1.0, 2.0, 3.0)


def test_blenders_names_are_all_there() -> None:
    """Its interpolation modes; bezier is drawn by handles."""
    ways = {f"{family}_{way}" for family in FAMILIES for way in ("in", "out", "in_out")}
    assert set(EASINGS) == ways | {"constant", "linear", *HAND_EASES}


@pytest.mark.parametrize("name", smooth)
def test_only_those_said_to_overshoot_leave_the_way(name: str) -> None:
    values = [EASINGS[name](i / 1000) for i in range(1001)]
    beyond = min(values) < -1e-9 or max(values) > 1 + 1e-9
    assert beyond == name.startswith(("back", "elastic", "settle"))


@pytest.mark.parametrize("way", ["in", "out", "in_out"])
def test_a_bounce_touches_the_ground_at_its_kinks_and_is_smooth_between(way: str) -> None:
    ease, edges = EASINGS[f"bounce_{way}"], [0.0, *kinks(f"bounce_{way}"), 1.0]
    for s in edges[1:-1]:
        assert min(abs(ease(s)), abs(ease(s) - 1), abs(ease(s) - 0.5)) < 1e-12
    for a, b in pairwise(edges):  # parabolas have no third difference
        values = [ease(a + (b - a) * (0.1 + 0.2 * i)) for i in range(4)]
        assert np.diff(values, 3) == pytest.approx(0, abs=1e-12)


@given(st.floats(0.01, 0.6))
def test_settle_passes_its_goal_by_its_number_and_ends_at_rest(overshoot: float) -> None:
    ease = easing(f"settle {overshoot}")
    values = [ease(i / 2000) for i in range(2001)]
    assert max(values) - 1 == pytest.approx(overshoot, rel=0.05)
    peak = values.index(max(values))
    assert 0.25 < peak / 2000 < 0.36  # the rest of the time, it swings ever less
    assert abs(min(values[peak:]) - 1) < overshoot
    assert abs(values[1] - values[0]) < 1e-3 and abs(values[-1] - values[-2]) < 1e-5


@given(st.floats(0.0, 0.8))
def test_drop_falls_by_gravity_and_each_bounce_has_less_energy(restitution: float) -> None:
    name = f"drop {restitution}"
    ease, touches = easing(name), [*kinks(name), 1.0]
    fall = touches[0]
    assert ease(0.5 * fall) == pytest.approx(0.25, abs=1e-9)  # a half of the time is a quarter of the height
    heights = [1.0]
    for start, end in pairwise(touches):
        assert ease(start) == pytest.approx(1.0, abs=1e-9)
        middle = 0.5 * (start + end)
        heights.append(1.0 - ease(middle))
        h = 0.1 * (end - start)  # as strong a gravity as in the fall
        bend = (ease(middle + h) - 2 * ease(middle) + ease(middle - h)) / h**2
        assert bend == pytest.approx(2 / fall**2, rel=1e-5)
    assert heights == pytest.approx([restitution ** (2 * k) for k in range(len(heights))])


@given(st.floats(0.5, 0.95))
def test_drag_is_half_way_at_its_number_and_arrives_softly(middle: float) -> None:
    ease = easing(f"drag {middle}")
    assert ease(middle) == pytest.approx(0.5)
    assert ease(0.2) < 0.11 and 1 - ease(0.9999) < 2e-5


def bezier(*keys: tuple[float, float, Handle | None, Handle | None], after: str = "hold") -> Keyframes:
    times, values, left, right = zip(*keys, strict=True)
    return Keyframes(
        times,
        tuple((v,) for v in values),
        ("bezier",) * len(keys),
        left,
        right,
        after=after,  # type: ignore[arg-type]
    )


def test_handles_on_the_chord_a_third_long_make_a_straight_way() -> None:
    keys = bezier((0.0, 1.0, None, Handle(1.0, (2.0,))), (3.0, 7.0, Handle(-1.0, (-2.0,)), None))
    for t in np.linspace(0, 3, 13):
        assert number_at(keys, float(t)) == pytest.approx(1 + 2 * t, abs=1e-14)


@given(st.floats(0, 3), st.floats(0, 3), st.floats(-2, 2), st.floats(-2, 2), st.floats(0.01, 0.99))
def test_a_bezier_way_lies_on_its_cubic(a: float, b: float, up: float, down: float, s: float) -> None:
    """Whatever the handles, the curve passes the point of its parameter, and time never turns back."""
    keys = bezier((0.0, 0.0, None, Handle(a, (up,))), (2.0, 1.0, Handle(-b, (down,)), None))
    shrink = min(1.0, 2.0 / (a + b)) if a + b > 0 else 1.0
    x = np.array([0.0, a * shrink, 2.0 - b * shrink, 2.0])
    y = np.array([0.0, up * shrink, 1.0 + down * shrink, 1.0])
    weights = np.array([(1 - s) ** 3, 3 * s * (1 - s) ** 2, 3 * s * s * (1 - s), s**3])
    moments = [float(np.array([(1 - q) ** 3, 3 * q * (1 - q) ** 2, 3 * q * q * (1 - q), q**3]) @ x)
               for q in (s - 0.01, s, s + 0.01)]  # fmt: skip
    assert moments[0] <= moments[1] <= moments[2]
    if moments[2] - moments[0] > 1e-4:  # where time stands still the value is not one of it
        assert number_at(keys, moments[1]) == pytest.approx(float(weights @ y), abs=1e-9)


@given(st.lists(st.floats(-5, 5), min_size=2, max_size=6))
def test_automatic_handles_never_overshoot(values: list[float]) -> None:
    keys = keyed(tuple(range(len(values))), tuple(values), "bezier")
    for i, (a, b) in enumerate(pairwise(values)):
        way = [number_at(keys, i + q / 20) for q in range(21)]
        assert min(a, b) - 1e-12 <= min(way) and max(way) <= max(a, b) + 1e-12
        assert np.all(np.diff(way) * np.sign(b - a) >= -1e-12)


def test_automatic_handles_go_smoothly_through_a_key() -> None:
    keys = keyed((0.0, 1.0, 3.0), (0.0, 1.0, 4.0), "bezier")
    h = 1e-6
    before, after = ((number_at(keys, 1 + side * h) - 1) / (side * h) for side in (-1, 1))
    assert before == pytest.approx(after, abs=1e-4) and before > 1


def looped(after: str, before: str = "hold", ease: str = "linear") -> Keyframes:
    rows = ((1.0,), (3.0,), (5.0,))
    return Keyframes((1.0, 2.0, 3.0), rows, (ease,) * 3, before=before, after=after)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("mode", "at", "value"),
    [
        ("hold", 3.5, 5.0),
        ("loop", 3.0, 1.0),
        ("loop", 3.5, 2.0),
        ("loop", 7.5, 2.0),
        ("ping_pong", 3.5, 4.0),
        ("ping_pong", 5.5, 2.0),
        ("offset", 3.5, 6.0),
        ("offset", 6.0, 11.0),
        ("continue", 4.0, 7.0),
    ],
)
def test_after_the_last_key_a_curve_goes_on_as_it_is_told(mode: str, at: float, value: float) -> None:
    assert number_at(looped(mode), at) == pytest.approx(value, abs=1e-12)
    mirrored = {"hold": 1.0, "loop": {3.0: 5.0}, "continue": -1.0}
    if mode in ("hold", "continue"):
        assert number_at(looped("hold", before=mode), 0.0) == mirrored[mode]


@pytest.mark.parametrize("mode", ["loop", "ping_pong", "offset"])
@given(time=st.floats(-20, 20), ease=st.sampled_from(smooth))
def test_rounds_repeat_on_both_sides(mode: str, time: float, ease: str) -> None:
    curve = looped(mode, mode, ease)
    turn = 4.0 if mode == "ping_pong" else 2.0
    gain = 4.0 if mode == "offset" else 0.0
    shares = (time - 1) / 1 % 1
    if 1e-6 < shares < 1 - 1e-6:
        assert number_at(curve, time + turn) == pytest.approx(number_at(curve, time) + gain, abs=1e-6)


def test_beyond_a_bezier_way_it_goes_on_along_the_handle() -> None:
    keys = bezier((0.0, 0.0, None, None), (2.0, 1.0, Handle(-0.5, (1.0,)), None), after="continue")
    assert number_at(keys, 3.0) == pytest.approx(-1.0)


def test_a_key_of_its_own_goes_on_by_holding() -> None:
    assert number_at(Keyframes((1.0,), ((2.0,),), ("linear",), after="continue", before="loop"), 9.0) == 2.0


def test_a_formula_knows_seconds_and_frames_between_them_too() -> None:
    wave = FormulaCurve(("4 * sin(2 * pi * t)",), fps=24.0, first=1)
    assert number_at(wave, 0.25) == pytest.approx(4.0, abs=1e-15)
    assert number_at(FormulaCurve(("frame",), 24.0, 101), 12.5 / 24) == 113.5
    assert [
        number_at(FormulaCurve(("floor(frame)",), 24000 / 1001, 1), k * 1001 / 24000) for k in range(200)
    ] == [k + 1 for k in range(200)]
