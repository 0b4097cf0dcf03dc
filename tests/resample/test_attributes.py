"""Attributes of vertices during resampling, and the state that a resumed film needs."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.arrays import Points
from flowsculpt.pipeline.mesh import TriangleMesh, icosphere
from flowsculpt.pipeline.mesh.analytic_surfaces import SphereSurface
from flowsculpt.pipeline.resample import (
    Chord,
    Curved,
    DistanceToCamera,
    Exact,
    Placement,
    Resampler,
    Thresholds,
)
from flowsculpt.pipeline.resample.placement import REST

STRETCH = np.array([1.06, 0.98, 0.97])


def pulled(points: Points, frames: int) -> Points:
    return points * STRETCH**frames


def exact(frames: list[int]) -> Exact:
    return Exact(lambda points: pulled(points, frames[0]), SphereSurface(1.0))


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from(["chord", "exact"]))
def test_linear_attributes_stay_linear_and_integers_are_always_somebodys(seed: int, name: str) -> None:
    """UV, colour and a number in any shape; under the paper's placement, what is linear in space stays so."""
    rng, ball, frames = np.random.default_rng(seed), icosphere(8), [0]
    slopes = rng.normal(size=(3, 5))
    label = rng.integers(-5, 1000, size=len(ball.vertices))
    flags = rng.random((len(ball.vertices), 2)) < 0.5
    mesh = TriangleMesh(
        ball.vertices,
        ball.faces,
        {
            "uv": (ball.vertices @ slopes)[:, :2],
            "heat": (ball.vertices @ slopes)[:, 4],
            "label": label,
            "flags": flags,
        },
    )
    placement: Placement = Chord() if name == "chord" else exact(frames)
    resampler = Resampler(mesh, Thresholds(0.2), placement)
    for _ in range(12):
        resampler.vertices[:] *= STRETCH
        frames[0] += 1
        resampler.resample()
    after = resampler.mesh
    home = after.vertices / STRETCH ** frames[0]
    near = 1e-9 if name == "chord" else 0.05  # a new vertex lies off the chord, where its parents' mean is
    assert np.abs(after.attributes["uv"] - (home @ slopes)[:, :2]).max() < near * np.abs(slopes).max() * 10
    assert np.abs(after.attributes["heat"] - (home @ slopes)[:, 4]).max() < near * np.abs(slopes).max() * 10
    assert after.attributes["label"].dtype == label.dtype
    assert set(after.attributes["label"].tolist()) <= set(label.tolist())
    assert after.attributes["flags"].dtype == bool
    assert {name: v.shape[1:] for name, v in after.attributes.items() if name in mesh.attributes} == {
        name: v.shape[1:] for name, v in mesh.attributes.items()
    }


def test_an_integer_says_of_which_first_vertex_every_vertex_descends() -> None:
    """Identity by inheritance: a number given to each vertex stays with it, and its children are near it."""
    ball = icosphere(8)
    resampler = Resampler(
        ball.with_attributes(origin=np.arange(len(ball.vertices))),
        Thresholds(0.12),
        Exact(lambda p: p, SphereSurface(1.0)),
    )
    assert resampler.resample().splits > 100
    after = resampler.mesh
    origin = after.attributes["origin"]
    assert np.array_equal(origin[: len(ball.vertices)], np.arange(len(ball.vertices)))
    assert np.linalg.norm(after.vertices - ball.vertices[origin], axis=1).max() < 0.3


ACTIVE = Thresholds(DistanceToCamera((3.0, 0.0, 0.0), 130.0, 0.1, 0.4))


@pytest.mark.parametrize("thresholds", [Thresholds(0.2), ACTIVE], ids=["numbers", "active"])
@pytest.mark.parametrize("name", ["chord", "curved", "exact"])
def test_a_film_goes_on_from_its_state_to_the_bit(thresholds: Thresholds, name: str) -> None:
    frames = [0]
    placement: Placement = {"chord": Chord(), "curved": Curved(), "exact": exact(frames)}[name]

    def advance(resampler: Resampler, start: int, end: int) -> dict[str, bytes]:
        for frame in range(start, end):
            frames[0] = frame + 1
            resampler.vertices[:] *= STRETCH
            resampler.resample()
        return {key: values.tobytes() for key, values in resampler.state().items()}

    straight = Resampler(icosphere(8), thresholds, placement, min_roundness=0.7)
    expected = advance(straight, 0, 14)
    stopped = Resampler(icosphere(8), thresholds, placement, min_roundness=0.7)
    advance(stopped, 0, 6)
    state = {key: values.copy() for key, values in stopped.state().items()}
    assert (f"attribute.{REST}" in state) == (name == "exact")
    resumed = Resampler.from_state(state, thresholds, placement, min_roundness=0.7)
    assert advance(resumed, 6, 14) == expected
