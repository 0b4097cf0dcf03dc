"""Velocity fields and their integration."""

from __future__ import annotations

import json
import math

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.arrays import Points, Vectors
from flowsculpt.pipeline.errors import FrameError
from flowsculpt.pipeline.flow import (
    Reversed,
    Sequence,
    Streamlines,
    Sum,
    VelocityField,
    checked_displacement,
    keyed,
)
from flowsculpt.pipeline.flow.catalogue import FLOWS
from flowsculpt.pipeline.flow.catalogue.basic import (
    ABC,
    DoubleGyre,
    Enright,
    Expansion,
    Rotation,
    Scaling,
    Sink,
    Source,
    Squeeze,
    Strain,
    Translation,
)
from flowsculpt.pipeline.flow.catalogue.lorenz import Lorenz
from flowsculpt.pipeline.flow.catalogue.vortices import SpiralVortex, Vortex, VortexPair, VortexRing
from flowsculpt.pipeline.flow.kernels import field_kernels as fields
from flowsculpt.pipeline.flow.kernels import instructions as op
from flowsculpt.pipeline.flow.kernels import streamline_kernels as kernels
from flowsculpt.pipeline.flow.kernels.field_kernels import velocities
from flowsculpt.pipeline.flow.parameters import summary
from flowsculpt.pipeline.flow.velocity import table_of

TILTED = (1.0, 2.0, -0.5)
OFF = (0.3, -0.2, 0.4)

FIELDS: dict[str, VelocityField] = {
    "translation": Translation((0.3, -1.0, 0.2)),
    "rotation": Rotation(TILTED, OFF, 2.0),
    "scaling": Scaling(OFF, (0.5, -0.9, 0.2)),
    "strain": Strain(TILTED, OFF, 0.8),
    "lamb-oseen vortex": Vortex(TILTED, OFF, 0.7, 3.0),
    "gaussian vortex": Vortex(TILTED, OFF, 0.7, 3.0, "gaussian"),
    "rankine vortex": Vortex(TILTED, OFF, 0.7, 3.0, "rankine"),
    "vortex pair": VortexPair(TILTED, OFF, distance=1.1, strength=3.0),
    "vortex ring": VortexRing(TILTED, OFF, 0.8, 0.35, 2.0),
    "spiral vortex": SpiralVortex(TILTED, OFF, 0.7, 3.0, 0.8),
    "ball": Expansion("ball", TILTED, OFF, 1.5, 0.8),
    "disc": Expansion("disc", TILTED, OFF, 1.5, -0.8),
    "source": Source(OFF, 0.6, 2.0),
    "sink": Sink(OFF, 0.6, 2.0),
    "squeeze": Squeeze(TILTED, OFF, 1.5, 0.9, 1.3),
    "abc": ABC(OFF),
    "double gyre": DoubleGyre(OFF, 4.0, 0.6),
    "enright": Enright(OFF, 3.0, 2.0),
    "lorenz": Lorenz(OFF),
}
FIXED = [
    name
    for name in FIELDS
    if name not in ("translation", "vortex pair", "vortex ring", "abc", "double gyre", "lorenz")
]
"""Those whose centre stays where it is."""

EQUATIONS = {
    code: getattr(fields, name.lower())
    for name, code in vars(fields).items()
    if isinstance(code, int) and hasattr(fields, name.lower())
}
each_field = pytest.mark.parametrize("field", FIELDS.values(), ids=FIELDS)


@pytest.fixture
def points() -> Points:
    return np.random.default_rng(7).normal(size=(200, 3))


def jacobian(field: VelocityField, points: Points, h: float = 1e-5, at: float = 0.0) -> Vectors:
    """(N, 3, 3): the derivative of velocity i in direction j, by central differences."""
    columns = []
    for j in range(3):
        aside = np.zeros(3)
        aside[j] = h
        columns.append((field.velocity(points + aside, at) - field.velocity(points - aside, at)) / (2 * h))
    return np.stack(columns, axis=2)


@pytest.mark.slow
@each_field
def test_halving_the_step_divides_the_error_by_sixteen(field: VelocityField, points: Points) -> None:
    if isinstance(field, Translation):
        pytest.skip("exact at any step")
    inside = 0.3 * points + OFF
    exact = Streamlines(field, 1024).displace(inside, 0.0, 0.8)
    errors = [
        np.sqrt(np.mean((Streamlines(field, n).displace(inside, 0.0, 0.8) - exact) ** 2)) for n in (64, 128)
    ]
    assert math.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.1)


def test_the_order_holds_for_keyed_parameters_too(points: Points) -> None:
    field = Vortex(strength=keyed((0.0, 2.0), (0.0, 6.0), "sine_in"), radius=0.8)
    exact = Streamlines(field, 512).displace(points, 0.1, 0.8)
    errors = [np.abs(Streamlines(field, n).displace(points, 0.1, 0.8) - exact).max() for n in (8, 16)]
    assert math.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.1)


@each_field
def test_the_chosen_substeps_are_accurate(field: VelocityField, points: Points) -> None:
    inside = 0.4 * points + OFF
    chosen = Streamlines(field).displace(inside, 0.0, 0.25)
    exact = Streamlines(field, 400).displace(inside, 0.0, 0.25)
    assert np.abs(chosen - exact).max() < 2e-5


@each_field
def test_the_gradient_bound_holds(field: VelocityField, points: Points) -> None:
    steepest = np.linalg.norm(jacobian(field, 0.3 * points + OFF), ord=2, axis=(1, 2)).max()
    assert steepest <= field.gradient_bound(0.0) * (1 + 1e-6)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.floats(-0.45, 0.45), st.floats(0.0, 3.0))
def test_two_gyres_and_their_mirror_images_are_nowhere_steeper_than_they_say(
    seed: int, swing: float, time: float
) -> None:
    field = DoubleGyre(OFF, 2.0, 0.6, swing)
    places = np.random.default_rng(seed).uniform(-12, 12, (100, 3))
    inside = (
        np.abs((places[:, 0] - OFF[0]) / 2.0 % 2.0 - 1.0) > 1e-4
    )  # not across a wall, where it has a kink
    steepest = np.linalg.norm(jacobian(field, places[inside], at=time), ord=2, axis=(1, 2)).max()
    assert steepest <= field.gradient_bound(time) * (1 + 1e-6)


def test_nothing_crosses_the_walls_of_two_gyres_and_beyond_they_are_mirrored() -> None:
    places = np.random.default_rng(4).uniform(-1, 1, (50, 3))
    field = DoubleGyre(speed=0.5)
    beside = places * [-1, 1, 1] + [2.0, 0, 0]
    expected = field.velocity(places, 0.4) * [-1, 1, 1]
    np.testing.assert_allclose(field.velocity(beside, 0.4), expected, atol=1e-13)
    further = places + np.array([4.0, 0, 0])
    np.testing.assert_allclose(field.velocity(further, 0.4), field.velocity(places, 0.4), atol=1e-13)
    wall = places * [0, 1, 1] + [1.0, 0, 0]
    np.testing.assert_allclose(field.velocity(wall, 0.4)[:, 0], 0.0, atol=1e-14)


@each_field
def test_a_field_that_says_so_keeps_volume_and_no_other_does(field: VelocityField, points: Points) -> None:
    divergence = np.abs(np.trace(jacobian(field, 0.5 * points, at=0.3), axis1=1, axis2=2)).max()
    assert divergence < 1e-8 if "keeps volume" in summary(type(field)) else divergence > 1e-3


def test_lorenz_shrinks_volume_at_its_constant_rate(points: Points) -> None:
    divergence = np.trace(jacobian(Lorenz(time_scale=0.3), points), axis1=1, axis2=2)
    np.testing.assert_allclose(divergence, -0.3 * (10 + 1 + 8 / 3), rtol=1e-6)


@pytest.mark.parametrize("name", ["lamb-oseen vortex", "gaussian vortex", "rankine vortex", "rotation"])
def test_turning_flows_keep_the_distance_from_the_axis_and_the_height(name: str, points: Points) -> None:
    axis = np.array(TILTED) / np.linalg.norm(TILTED)
    moved = Streamlines(FIELDS[name], 64).displace(points, 0.0, 1.0)
    for before, after in ((points - OFF, moved - OFF),):
        np.testing.assert_allclose(after @ axis, before @ axis, atol=1e-9)
        across = [np.linalg.norm(p - np.outer(p @ axis, axis), axis=1) for p in (before, after)]
        np.testing.assert_allclose(across[1], across[0], atol=1e-7)


def test_a_flow_is_the_same_seen_from_around_its_axis(points: Points) -> None:
    turn = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    along = {"axis": (0.0, 0.0, 1.0)}
    for field in (
        Vortex(),
        Expansion("disc"),
        Source(),
        Strain(**along),
        Squeeze(**along),
        VortexRing(**along),
        SpiralVortex(**along),
    ):
        np.testing.assert_allclose(
            field.velocity(points @ turn.T, 0.0), field.velocity(points, 0.0) @ turn.T, atol=1e-13
        )


@pytest.mark.parametrize("name", FIXED)
def test_the_centre_is_a_fixed_point(name: str) -> None:
    centre = np.array([OFF])
    np.testing.assert_allclose(Streamlines(FIELDS[name]).displace(centre, 0.0, 2.0), centre, atol=1e-15)


def test_the_eyes_of_lorenz_are_fixed_points() -> None:
    eye = math.sqrt(8 / 3 * 27)
    eyes = np.array([[eye, 0.0, -eye], [-eye, 0.0, eye]]) / 20.0
    moved = Streamlines(Lorenz(time_scale=1.0)).displace(eyes, 0.0, 0.1)
    np.testing.assert_allclose(moved, eyes, atol=1e-14)


def test_lorenz_in_its_own_coordinates_is_the_equations_of_1963() -> None:
    x, y, z = 3.0, -5.0, 20.0
    own = 10.0 * (y - x), x * (28.0 - z) - y, x * y - 8 / 3 * z
    here = np.array([[x, z - 27.0, -y]]) / 20.0
    velocity = Lorenz(time_scale=0.5).velocity(here, 0.0)[0] * 20.0 / 0.5
    np.testing.assert_allclose(velocity, [own[0], own[2], -own[1]], rtol=1e-13)


def test_a_vortex_is_the_formula_of_the_textbook_near_and_far() -> None:
    r = np.geomspace(1e-6, 50.0, 400)
    points = np.stack([r, 0 * r, 0 * r], axis=1)
    speed = Vortex(radius=0.7, strength=3.0).velocity(points, 0.0)[:, 1]
    np.testing.assert_allclose(speed, -3.0 / (2 * np.pi * r) * np.expm1(-((r / 0.7) ** 2)), rtol=3e-11)


def test_nothing_moves_on_and_beyond_the_rim_of_an_expansion(points: Points) -> None:
    far = points / np.linalg.norm(points, axis=1)[:, None] * np.linspace(1.5, 9.0, len(points))[:, None]
    ball = Streamlines(Expansion("ball", radius=1.5, rate=5.0))
    np.testing.assert_array_equal(ball.displace(far, 0.0, 1.0), far)


def test_both_vortices_turn_alike_on_the_axis_and_differ_far_away() -> None:
    near, far = np.array([[1e-4, 0.0, 0.0]]), np.array([[5.0, 0.0, 0.0]])
    lamb, gauss = Vortex(strength=2.0), Vortex(strength=2.0, profile="gaussian")
    np.testing.assert_allclose(lamb.velocity(near, 0.0), gauss.velocity(near, 0.0), rtol=1e-7)
    assert lamb.velocity(far, 0.0)[0, 1] == pytest.approx(2.0 / (2 * math.pi * 5.0))
    assert gauss.velocity(far, 0.0)[0, 1] < 1e-9


@settings(max_examples=30, deadline=None)
@given(st.floats(-4, 4), st.floats(0.3, 2.0), st.floats(-1, 1), st.floats(0.1, 1.0))
def test_a_reversed_flow_returns_every_point(strength: float, radius: float, rate: float, dt: float) -> None:
    points = np.random.default_rng(3).normal(size=(50, 3))
    strengths = keyed((0.0, 1.0), (0.0, strength))
    field = Sum((Vortex(radius=radius, strength=strengths), Strain(rate=rate)))
    flow = Sequence((Streamlines(field, 200), Streamlines(Rotation(), 100)))
    there = flow.displace(points, 0.0, dt)
    back = Reversed(flow, dt).displace(there, 0.0, dt)
    np.testing.assert_allclose(back, points, atol=1e-6)


@pytest.mark.slow
def test_the_number_of_threads_changes_no_bit(points: Points) -> None:
    many = np.random.default_rng(1).normal(size=(5 * op.BLOCK + 23, 3))
    flow = Streamlines(Sum(tuple(FIELDS.values())))
    before = numba.get_num_threads()
    try:
        results = []
        for threads in (1, min(2, numba.config.NUMBA_NUM_THREADS)):
            numba.set_num_threads(threads)
            results.append(flow.displace(many, 0.0, 0.1))
    finally:
        numba.set_num_threads(before)
    np.testing.assert_array_equal(results[0], results[1])
    alone = np.concatenate([flow.displace(many[i : i + 1], 0.0, 0.1) for i in range(20)])
    np.testing.assert_array_equal(results[0][:20], alone)


@each_field
def test_the_kernel_says_the_same_as_plain_python(field: VelocityField, points: Points) -> None:
    program = field.program(0.3)
    table = table_of(program).ravel()
    plain = np.zeros((20, 3))
    for k, row in enumerate(program):
        equation = EQUATIONS[row.opcode].py_func
        plain += [equation(table, k * op.COLUMNS, *point) for point in points[:20]]
    np.testing.assert_allclose(field.velocity(points[:20], 0.3), plain, rtol=1e-12, atol=1e-12)


def test_every_field_of_the_catalogue_and_every_equation_is_tested_here() -> None:
    assert {type(f) for f in FIELDS.values()} == {f for f in FLOWS if issubclass(f, VelocityField)}
    assert {row.opcode for field in FIELDS.values() for row in field.program(0.0)} == EQUATIONS.keys()


def test_parameters_and_compositions_compile_nothing(points: Points) -> None:
    """Whatever comes, the kernels see the one set of types that they are compiled for."""
    frozen = points.copy()
    frozen.flags.writeable = False
    for count in range(1, 6):
        field = Sum(tuple(list(FIELDS.values())[:count]))
        for array in (points * count, frozen, np.asfortranarray(points), points.astype(np.float32)):
            Streamlines(field, count).displace(array, 0.1 * count, 0.02 * count)
            field.velocity(array, 0.0)
    assert len(kernels.advect.signatures) == len(velocities.signatures) == 1


def test_a_field_too_steep_to_follow_is_refused_by_name() -> None:
    flow = Streamlines(Vortex(radius=1e-4, strength=100.0))
    with pytest.raises(
        FrameError, match=r"flow vortex at 0 s needs .* sub-steps.* Raise radius, lower strength"
    ):
        flow.displace(np.zeros((1, 3)), 0.0, 1 / 24)


def test_a_field_that_grows_too_steep_fails_in_its_frame_and_not_in_the_plan() -> None:
    flow = Streamlines(Vortex(radius=1e-4, strength=keyed((0.0, 1.0), (0.0, 100.0), "linear")))
    data = [flow.cache_data(time, 1 / 24) for time in (0.0, 0.5, 0.75)]
    assert data[1] != data[2] and json.loads(json.dumps(data)) == data
    with pytest.raises(FrameError, match=r"^frame 13: flow vortex at 0\.5 s needs") as told:
        checked_displacement(flow, np.zeros((1, 3)), 0.5, 1 / 24, 13)
    assert told.value.frame == 13


def test_a_number_of_substeps_that_would_fill_the_memory_is_refused_too() -> None:
    flow = Streamlines(Vortex(), substeps=10**12)
    assert flow.cache_data(0.0, 1 / 24) != Streamlines(Vortex(), substeps=1).cache_data(0.0, 1 / 24)
    with pytest.raises(FrameError, match=r"needs 1e\+12 sub-steps a frame; 10000 are the most"):
        flow.displace(np.zeros((1, 3)), 0.0, 1 / 24)


def test_the_enright_field_is_that_of_its_paper_and_undoes_itself_in_a_period() -> None:
    """LeVeque 1996, in the unit cube; for some other cube, lengths and speeds grow with it."""
    rng = np.random.default_rng(9)
    points, t = rng.uniform(0, 1, (50, 3)), 0.4
    s, d, c = np.sin(np.pi * points) ** 2, np.sin(2 * np.pi * points), math.cos(math.pi * t / 3)
    u, v, w = 2 * s[:, 0] * d[:, 1] * d[:, 2], -d[:, 0] * s[:, 1] * d[:, 2], -d[:, 0] * d[:, 1] * s[:, 2]
    field = Enright((0.5, 0.5, 0.5), 1.0, 3.0)
    np.testing.assert_allclose(field.velocity(points, t), c * np.column_stack([u, v, w]), atol=1e-14)
    larger = Enright(OFF, 5.0, 3.0)
    moved = larger.velocity(5.0 * (points - 0.5) + OFF, t)
    np.testing.assert_allclose(moved, 5.0 * field.velocity(points, t), atol=1e-13)
    there = Streamlines(field).displace(points, 0.0, 1.5)
    back = Streamlines(field).displace(there, 1.5, 1.5)
    assert np.abs(there - points).max() > 0.3
    np.testing.assert_allclose(back, points, atol=1e-4)
