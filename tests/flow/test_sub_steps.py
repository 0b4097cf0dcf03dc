"""Sub-steps follow from the flow, not from the mesh, and pass by nothing that moves a point."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.arrays import Points
from flowsculpt.pipeline.flow import Streamlines, Sum, VelocityField, keyed
from flowsculpt.pipeline.flow.catalogue import FLOWS
from flowsculpt.pipeline.flow.catalogue.basic import Expansion, Rotation, Translation
from flowsculpt.pipeline.flow.catalogue.vortices import Vortex
from flowsculpt.pipeline.flow.composition import Mirror, RegionField, ScaledField, Transform, TransformedField
from flowsculpt.pipeline.flow.regions import BoxRegion, SphereRegion
from flowsculpt.pipeline.mesh import icosphere
from flowsculpt.pipeline.plugins.fields.attraction import Attraction, Target
from flowsculpt.pipeline.plugins.fields.curl_noise import CurlNoise
from flowsculpt.pipeline.shot import read_shot

DT = 1 / 24
BOUND = 1e-5
"""The error of a frame, in length scales of the field, where frame × gradient bound is at most 1."""

FIELDS: dict[str, VelocityField] = {
    **{flow.__name__: flow() for flow in FLOWS if issubclass(flow, VelocityField)},
    "gaussian": Vortex(profile="gaussian"),
    "rankine": Vortex(profile="rankine"),
    "disc": Expansion("disc"),
    "attraction": Attraction(Target.surface(icosphere(4))),
    "curl_noise": CurlNoise(),
    "region": RegionField(Rotation(), SphereRegion(radius=0.5, falloff=0.3)),
    "thin region": RegionField(Translation((0.0, 1.0, 0.0)), BoxRegion(size=(0.02, 9, 9), falloff=0.02)),
    "linear falloff": RegionField(Rotation(), SphereRegion(radius=0.5, falloff=0.3, falloff_type="linear")),
    "half": ScaledField(Vortex(radius=0.3), 0.5),
    "smaller": TransformedField(Vortex(), Transform(scale=0.2)),
    "mirror": TransformedField(Vortex(centre=(0.5, 0.0, 0.0)), Mirror()),
}


def error(flow: Streamlines, points: Points, time: float, dt: float, substeps: int = 3000) -> float:
    """Return the largest distance from where so many sub-steps bring the points."""
    exact = Streamlines(flow.field, substeps=substeps).displace(points, time, dt)
    return float(np.linalg.norm(flow.displace(points, time, dt) - exact, axis=1).max())


@settings(max_examples=40, deadline=None)
@given(st.sampled_from(sorted(FIELDS)), st.floats(0.01, 1.0), st.floats(0.0, 2.0), st.integers(0, 99))
def test_a_frame_errs_by_less_than_its_bound(name: str, change: float, time: float, seed: int) -> None:
    """`change` is the frame's seconds × gradient bound: the films have 0.01 to 1."""
    field = FIELDS[name]
    bound = field.gradient_bound(time)
    dt = change / bound if bound else 1.0
    points = np.random.default_rng(seed).uniform(-1.0, 1.0, (40, 3))
    assert error(Streamlines(field), points, time, dt, 600) <= BOUND * min(field.length_scale(time), 1.0)


@settings(max_examples=15, deadline=None)
@given(st.floats(0.005, 0.1), st.floats(1.0, 20.0), st.integers(0, 99))
def test_no_point_passes_by_a_narrow_vortex(radius: float, speed: float, seed: int) -> None:
    """A frame carries points many radii far; a gradient bound alone takes one sub-step."""
    vortex = Vortex(radius=radius, strength=0.2 * radius**2)
    swept = Streamlines(Sum((vortex, Translation((speed, 0.0, 0.0)))))
    rng = np.random.default_rng(seed)
    ahead = np.array([-0.5 * speed * DT, 0.0, 0.0]) + rng.uniform(-2.0, 2.0, (40, 3)) * radius
    assert swept.gradient_substeps(0.0, DT) == 1
    assert error(swept, ahead, 0.0, DT) <= BOUND * radius


def test_points_do_pass_by_it_where_steps_may_be_long() -> None:
    vortex = Vortex(radius=0.02, strength=0.001)
    ahead = np.array([-0.05, 0.0, 0.0]) + np.random.default_rng(1).uniform(-0.04, 0.04, (40, 3))
    swept = Streamlines(Sum((vortex, Translation((3.0, 0.0, 0.0)))), max_step=9.0)
    assert error(swept, ahead, 0.0, DT) > 100 * BOUND * 0.02


@pytest.mark.parametrize("moves", ["centre", "transform"])
def test_no_narrow_vortex_passes_by_a_point(moves: str) -> None:
    path = keyed((0.0, DT), ((-1.0, 0.0, 0.0), (1.0, 0.0, 0.0)), "linear")
    field: VelocityField = Vortex(radius=0.05, strength=0.01, centre=path)
    if moves == "transform":
        field = TransformedField(Vortex(radius=0.05, strength=0.01), Transform(translate=path))
    points = np.random.default_rng(2).uniform(-0.05, 0.05, (40, 3))
    flow = Streamlines(field)
    assert flow.gradient_substeps(0.0, DT) >= 2.0 / 0.025
    assert error(flow, points, 0.0, DT) <= BOUND * 0.05


def test_a_flow_that_stands_still_has_no_narrow_detail() -> None:
    off = keyed((0.0, 1.0), (0.0, 0.0))
    swept = Sum((Vortex(radius=0.001, strength=off), Translation((9.0, 0.0, 0.0))))
    assert Streamlines(swept).longest_step(0.2, DT) == np.inf


def test_data_of_a_step_do_not_depend_on_the_steps_asked_for_before() -> None:
    swept = keyed((0.0, 1.0), ((0.0, 0.0, 0.0), (3.0, 0.0, 0.0)))
    field = Sum((Vortex(centre=swept, strength=keyed((0.0, 1.0), (0.0, 9.0))), CurlNoise()))
    asked, times = Streamlines(field), [DT * n for n in range(20)]
    found = {time: asked.cache_data(time, DT) for time in [*times, *reversed(times[::3])]}
    assert found == {time: Streamlines(field).cache_data(time, DT) for time in times}
    assert asked.cache_data(times[1], -DT) == Streamlines(field).cache_data(times[1], -DT)


def test_fine_and_coarse_meshes_take_the_same_sub_steps(tmp_path: Path) -> None:
    plans = []
    for edge in (0.2, 0.002):
        shot = tmp_path / "a.yaml"
        shot.write_text(
            "title: A\nlook: clay\nframes: 1-9\nsubject: {solid: icosphere}\n"
            f"resample: {{max_edge_length: {edge}}}\n"
            "flows: [{vortex: {strength: 9, radius: 0.4}}, {lorenz: {time_scale: 0.3}}]\n"
        )
        motion = read_shot(shot).motion
        plans.append([motion.step_data(frame) for frame in range(2, 10)])
    assert plans[0] == plans[1]
