"""Fields that functions of their own compute: formulas, turbulence, attraction, wind."""

from __future__ import annotations

import json
import math

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.arrays import Floats, Points
from flowsculpt.pipeline.errors import FrameError, UsageError
from flowsculpt.pipeline.flow import Streamlines, Sum, VelocityField, checked_displacement, keyed
from flowsculpt.pipeline.flow.catalogue.basic import Rotation
from flowsculpt.pipeline.flow.composition import Mirror, ScaledField, Transform, TransformedField
from flowsculpt.pipeline.flow.kernels import streamline_kernels as kernels
from flowsculpt.pipeline.flow.kernels.field_kernels import velocities
from flowsculpt.pipeline.flow.velocity import ExternalField
from flowsculpt.pipeline.mesh import icosphere, torus
from flowsculpt.pipeline.plugins.fields.attraction import Attraction, Target, Wind, catmull_rom
from flowsculpt.pipeline.plugins.fields.curl_noise import RMS, CurlNoise
from flowsculpt.pipeline.plugins.fields.formula_field import FormulaField, largest_norm

PATH = ((-1.0, 0.0, 0.0), (0.0, 1.0, 0.5), (1.0, 0.0, 0.0), (2.0, 0.5, 1.0))
FIELDS: dict[str, ExternalField] = {
    "formula": FormulaField(("-k * y", "k * x", "0.3 * sin(t) * z"), (("k", 2.0),)),
    "functions": FormulaField(("sin(3 * y) * exp(-x * x)", "cos(x + t) - log(1 + z * z)", "exp(sin(5 * x))")),
    "curl noise": CurlNoise(0.8, 0.5, octaves=2),
    "attraction": Attraction(Target.points(np.array([[0.2, 0.1, 0.0]])), 1.5, 3.0),
    "repulsion": Attraction(Target.surface(icosphere(4, 0.5)), -0.5, 2.0),
    "wind": Wind(PATH, 0.5, 2.0),
}
each_field = pytest.mark.parametrize("field", FIELDS.values(), ids=FIELDS)


@pytest.fixture
def points() -> Points:
    return 0.4 * np.random.default_rng(7).normal(size=(300, 3))


def gradients(field: ExternalField, points: Points, h: float = 1e-5, time: float = 0.3) -> Floats:
    """(N, 3, 3): the derivative of velocity i in direction j, by central differences."""
    pairs = [field.velocity(points + h * e, time) - field.velocity(points - h * e, time) for e in np.eye(3)]
    return np.stack(pairs, axis=2) / (2 * h)


@settings(max_examples=60)
@given(
    count=st.integers(0, 40),
    rank=st.integers(0, 3),
    exponent=st.integers(-140, 140),
    seed=st.integers(0, 2**32 - 1),
)
def test_the_largest_norm_is_that_of_all_singular_values_to_the_bit(
    count: int, rank: int, exponent: int, seed: int
) -> None:
    random = np.random.default_rng(seed)
    matrices = random.normal(size=(count, 3, 3)) * random.random((count, 1, 1)) * 10.0**exponent
    matrices[:, rank:] = 0.0
    matrices = np.concatenate([matrices, matrices[:2]])
    expected = np.linalg.norm(matrices, ord=2, axis=(1, 2)).max(initial=0.0)
    assert largest_norm(matrices) == expected


@each_field
def test_the_kernels_call_the_function_and_nothing_else(field: ExternalField, points: Points) -> None:
    columns = np.ascontiguousarray(points.T)
    alone = np.zeros_like(columns)
    field.block(np.array(field.numbers(0.3) or (0.0,)), columns, 0.3, alone)
    np.testing.assert_array_equal(field.velocity(points, 0.3), alone.T)
    both = Sum((Rotation(), field))
    expected = Rotation().velocity(points, 0.3) + alone.T
    np.testing.assert_allclose(both.velocity(points, 0.3), expected, rtol=1e-13, atol=1e-15)


@each_field
def test_points_and_threads_change_no_bit(field: ExternalField) -> None:
    many = np.random.default_rng(1).normal(size=(9001, 3))
    before, results = numba.get_num_threads(), []
    try:
        for threads in (1, min(2, numba.config.NUMBA_NUM_THREADS)):
            numba.set_num_threads(threads)
            results.append(Streamlines(field, 2).displace(many, 0.1, 0.05))
    finally:
        numba.set_num_threads(before)
    np.testing.assert_array_equal(results[0], results[1])
    alone = np.concatenate([Streamlines(field, 2).displace(many[i : i + 1], 0.1, 0.05) for i in range(10)])
    np.testing.assert_array_equal(results[0][:10], alone)
    for first, last in ((250, 262), (255, 257), (256, 699)):  # about the end of a block
        part = Streamlines(field, 2).displace(many[first:last], 0.1, 0.05)
        assert part.tobytes() == results[0][first:last].tobytes()


@each_field
def test_what_acts_is_plain_data_without_addresses(field: ExternalField) -> None:
    data = Streamlines(field).cache_data(0.25, 1 / 24)
    assert json.loads(json.dumps(data)) == data
    assert str(field.block.address) not in json.dumps(data)


@pytest.mark.parametrize("name", ["formula", "curl noise"])
def test_halving_the_step_divides_the_error_by_sixteen(name: str, points: Points) -> None:
    exact = Streamlines(FIELDS[name], 256).displace(points, 0.1, 0.8)
    errors = [
        np.abs(Streamlines(FIELDS[name], n).displace(points, 0.1, 0.8) - exact).mean() for n in (16, 32)
    ]
    assert math.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.1)


@pytest.mark.parametrize("name", ["formula", "attraction", "repulsion", "wind"])
def test_the_gradient_bound_holds_off_the_jumps(name: str, points: Points) -> None:
    field = FIELDS[name]
    norms = np.linalg.norm(gradients(field, points), ord=2, axis=(1, 2))
    assert np.quantile(norms, 0.99) <= field.gradient_bound(0.3) * (1 + 1e-6)


def test_parameters_of_formulas_and_new_formulas_compile_no_kernel(points: Points) -> None:
    for k in range(4):
        field = FormulaField(("-k * y", f"{k} * x", "0"), (("k", float(k)),))
        Streamlines(Sum((field, Rotation())), 2).displace(points, 0.0, 0.1)
    assert len(kernels.advect.signatures) <= 1 and len(velocities.signatures) <= 1
    assert (
        FormulaField(("k", "0", "0"), (("k", 1.0),)).block
        is FormulaField(("k", "0", "0"), (("k", 2.0),)).block
    )


def test_a_formula_turns_as_the_rotation_does(points: Points) -> None:
    speed = keyed((0.0, 1.0), (0.0, 2.0), "linear")
    written = FormulaField(("-k * y", "k * x", "0"), (("k", speed),))
    built = Rotation((0.0, 0.0, 1.0), speed=speed)
    moved = [Streamlines(field, 8).displace(points, 0.2, 0.5) for field in (written, built)]
    np.testing.assert_allclose(*moved, atol=1e-13)


def test_only_a_formula_that_speaks_of_time_acts_otherwise_later() -> None:
    still, moving = (Streamlines(FormulaField((text, "0", "0")), 1) for text in ("x", "x * t"))
    assert still.cache_data(0.0, 0.1) == still.cache_data(5.0, 0.1)
    assert moving.cache_data(0.0, 0.1) != moving.cache_data(5.0, 0.1)


def test_numbers_that_no_formula_speaks_of_do_not_act() -> None:
    one, other, used = (
        Streamlines(FormulaField(("k", "0", "0"), (("k", k), ("j", j)))) for k, j in ((1, 2), (1, 3), (2, 2))
    )
    assert one.cache_data(0.0, 0.1) == other.cache_data(0.0, 0.1) != used.cache_data(0.0, 0.1)


def test_a_formula_that_divides_by_zero_is_told_with_column_and_place(points: Points) -> None:
    points[7] = (1.0, 0.0, 0.5)
    flow = Streamlines(Sum((Rotation(speed=0.0), FormulaField(("0", "0", "0.1 / y")))), 1)
    with pytest.raises(
        FrameError, match=r"^frame 9: flow .*column 1: 0.1 / y is inf at x 1, y 0, z 0.5, t 2"
    ):
        checked_displacement(flow, points, 2.0, 0.04, 9)


def test_it_is_told_with_an_error_limit_too() -> None:
    flow = Streamlines(FormulaField(("1/x", "0", "0")), tolerance=1e-6)
    with pytest.raises(FrameError, match="formula"):
        checked_displacement(flow, np.zeros((3, 3)), 0.0, 1 / 24, 2)


DIVIDES = FormulaField(("0", "0", "0.1 / y"))


@pytest.mark.parametrize(
    ("field", "height"),
    [
        (TransformedField(DIVIDES, Transform((1.0, 1.0, 0.5), (0.0, 0.0, 0.0), 2.0)), 1.0),
        (TransformedField(DIVIDES, Mirror((0.0, 1.0, 0.0), (0.0, 1.0, 0.0))), 2.0),
        (ScaledField(DIVIDES, 0.5), 0.0),
    ],
    ids=["placed", "mirrored", "scaled"],
)
def test_a_formula_within_a_composition_is_told_with_the_place_that_it_sees(
    field: VelocityField, height: float, points: Points
) -> None:
    points[7] = (1.0, height, 0.5)
    with pytest.raises(FrameError, match=r"column 1: 0\.1 / y is -?inf at x \S+, y -?0, z \S+, t 2"):
        checked_displacement(Streamlines(field, 1), points, 2.0, 0.04, 9)


def test_a_formula_has_ten_numbers_at_most() -> None:
    words = tuple((f"k{i}", 1.0) for i in range(11))
    with pytest.raises(UsageError, match="11 numbers of its own; 10 are the most"):
        FormulaField(("k0", "0", "0"), words)
    ten = FormulaField(("k9", "0", "0"), tuple((name, float(i)) for i, (name, _) in enumerate(words[:10])))
    np.testing.assert_array_equal(ten.velocity(np.zeros((1, 3)), 0.0), [[9.0, 0.0, 0.0]])


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**50), st.integers(1, 5), st.floats(-50, 50), st.floats(0, 1))
def test_turbulence_keeps_volume_to_rounding(seed: int, octaves: int, time: float, roughness: float) -> None:
    points = np.random.default_rng(5).uniform(-30, 30, size=(200, 3))
    field = CurlNoise(2.0, 1.0, octaves, roughness, seed=seed)
    turned = gradients(field, points, 1e-4, time)
    size = np.abs(turned).max()
    assert np.abs(np.trace(turned, axis1=1, axis2=2)).max() < 1e-4 * size
    halved = np.trace(gradients(field, points, 5e-5, time), axis1=1, axis2=2)
    assert np.abs(halved).max() < 0.5e-4 * size, "what is left shrinks with the step: it is the difference's"


def test_turbulence_has_the_speed_that_it_says_at_all_times_and_any_octaves() -> None:
    points = np.random.default_rng(2).uniform(-40, 40, size=(60_000, 3))
    for octaves, time in ((1, 0.0), (1, 1.0), (3, 0.6)):
        speed = CurlNoise(1.0, 2.0, octaves, seed=3).velocity(points, time)
        assert np.sqrt((speed**2).sum(axis=1).mean()) == pytest.approx(2.0, rel=0.02)
        assert np.abs(speed.mean(axis=0)).max() < 0.05
    assert CurlNoise(1.0, 1.0, 1).numbers(0.0)[1] * RMS == pytest.approx(1.0)


def test_few_points_of_turbulence_exceed_its_gradient_bound() -> None:
    points = np.random.default_rng(3).uniform(-40, 40, size=(40_000, 3))
    for octaves in (1, 3):
        field = CurlNoise(1.0, 1.0, octaves, 0.6)
        norms = np.linalg.norm(gradients(field, points), ord=2, axis=(1, 2))
        assert (norms > field.gradient_bound(0.0)).mean() < 3e-4
        assert norms.max() > 0.5 * field.gradient_bound(0.0)


def test_turbulence_is_smooth_in_time_and_another_with_every_seed(points: Points) -> None:
    field = CurlNoise(evolution=0.5)
    for time in (0.7, 2.0):  # between two draws of the dice, and at one
        near = field.velocity(points, time + 1e-6) - field.velocity(points, time - 1e-6)
        assert np.abs(near).max() < 1e-4
    assert np.abs(field.velocity(points, 0.0) - field.velocity(points, 2.0)).mean() > 0.1
    other = CurlNoise(evolution=0.5, seed=1).velocity(points, 0.0)
    assert abs(np.corrcoef(other.ravel(), field.velocity(points, 0.0).ravel())[0, 1]) < 0.3
    np.testing.assert_array_equal(field.velocity(points, 0.5), CurlNoise(evolution=0.5).velocity(points, 0.5))


def nearest(triangles: Floats, place: Floats) -> float:
    """The distance to triangles, the slow way: over inside, edges and corners, by projection."""
    best = math.inf
    for a, b, c in triangles:
        normal = np.cross(b - a, c - a)
        if normal @ normal > 0:
            share = np.linalg.lstsq(np.stack([b - a, c - a], axis=1), place - a, rcond=None)[0]
            if (share >= 0).all() and share.sum() <= 1:
                best = min(best, abs((place - a) @ normal) / math.sqrt(normal @ normal))
        for p, q in ((a, b), (b, c), (c, a)):
            length2 = (q - p) @ (q - p)
            s = 0.0 if length2 == 0 else min(max((place - p) @ (q - p) / length2, 0.0), 1.0)
            best = min(best, float(np.linalg.norm(p + s * (q - p) - place)))
    return best


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 60))
def test_the_nearest_point_of_any_triangles_is_found(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    triangles = rng.normal(size=(count, 1, 3)) + 0.3 * rng.normal(size=(count, 3, 3))
    triangles[: count // 3, 2] = triangles[: count // 3, 1]  # segments
    triangles[count // 4 : count // 3, 1] = triangles[count // 4 : count // 3, 0]
    triangles[: count // 6, 1] = triangles[: count // 6, 2] = triangles[: count // 6, 0]  # points
    places, far = rng.normal(size=(4, 3)), 1e6
    pulled = Attraction(Target.of(triangles), 1.0, far).velocity(places, 0.0)
    found = np.linalg.norm(pulled, axis=1)
    np.testing.assert_allclose(found, [nearest(triangles, place) for place in places], rtol=1e-9, atol=1e-12)


def test_attraction_follows_its_formula_and_ends_at_the_radius() -> None:
    field = Attraction(Target.points(np.zeros((1, 3))), 2.0, 1.5)
    r = np.array([0.0, 0.3, 1.0, 1.4999, 1.5, 4.0])
    pulled = field.velocity(np.stack([r, 0 * r, 0 * r], axis=1), 0.0)
    np.testing.assert_allclose(pulled[:, 0], -2.0 * r * np.maximum(1 - (r / 1.5) ** 2, 0) ** 2, atol=1e-15)
    assert not pulled[-2:].any()


def test_attraction_brings_points_onto_a_surface_and_repulsion_away_from_it() -> None:
    mesh = torus(1.0, 0.4, 0.2)
    start = np.random.default_rng(4).normal(size=(100, 3))
    target = Target.surface(mesh)
    gap = lambda places: np.linalg.norm(Attraction(target, 1.0, 1e6).velocity(places, 0.0), axis=1)  # noqa: E731
    drawn = Streamlines(Attraction(target, 4.0, 10.0)).displace(start, 0.0, 3.0)
    pushed = Streamlines(Attraction(target, -0.5, 10.0)).displace(start, 0.0, 0.2)
    assert gap(drawn).max() < 1e-3 * gap(start).max()
    assert (gap(pushed) > gap(start)).mean() > 0.95  # the others are drawn across the hole


@pytest.mark.parametrize("closed", [False, True])
def test_a_curve_goes_through_its_points_along_its_tangents(closed: bool) -> None:
    off = []
    for pieces in (32, 128):
        curve, tangents = catmull_rom(np.array(PATH), closed, pieces)
        np.testing.assert_allclose(curve[: 3 * pieces + 1 : pieces], PATH, atol=1e-15)
        np.testing.assert_allclose(np.linalg.norm(tangents, axis=1), 1.0)
        steps = np.diff(curve, axis=0) / np.linalg.norm(np.diff(curve, axis=0), axis=1, keepdims=True)
        off.append(np.linalg.norm(steps - 0.5 * (tangents[:-1] + tangents[1:]), axis=1).max())
    assert off[0] < 0.05 and off[1] < off[0] / 12, "chords come to lie along the tangents, by the square"
    if closed:
        np.testing.assert_array_equal([curve[0], tangents[0]], [curve[-1], tangents[-1]])


def test_wind_blows_at_its_speed_along_the_curve_and_not_beyond_its_radius() -> None:
    field = Wind(PATH, 2.0, 0.5)
    curve, tangents = catmull_rom(np.array(PATH), False, 16)
    np.testing.assert_allclose(field.velocity(curve, 0.0), 2.0 * tangents, atol=1e-9)
    assert not field.velocity(curve + np.array([0.0, 0.0, 9.0]), 0.0).any()
    carried = Streamlines(Wind(PATH, 1.0, 0.5), 64).displace(curve[:1], 0.0, 2.0)
    fine, _ = catmull_rom(np.array(PATH), False, 2000)
    assert np.linalg.norm(fine - carried, axis=1).min() < 0.01


def test_a_point_that_is_no_number_harms_nobody(points: Points) -> None:
    points[3] = np.nan
    for field in FIELDS.values():
        others = np.delete(np.arange(len(points)), 3)
        velocity: VelocityField = field
        assert np.isfinite(velocity.velocity(points, 0.0)[others]).all()
