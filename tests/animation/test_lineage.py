"""Identities of vertices, and the lineage of those born on the way."""

from __future__ import annotations

import numpy as np
import pytest

from flowsculpt.pipeline.animation import MeshFrame, animate, descent
from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.resample import Thresholds
from flowsculpt.pipeline.shot import Motion
from tests.animation.motions import EDGE, births, resampled
from tests.needed_plugins import needs_plugins


def test_the_vertices_of_a_film_are_numbered_and_every_birth_is_in_its_frame(motion: Motion) -> None:
    told = len(motion.mesh_at_rest().vertices)
    alive = set(range(told))
    for frame in animate(motion):
        assert births(frame)[:, 0].tolist() == list(range(told, frame.identities))
        told = frame.identities
        alive |= set(births(frame)[:, 0].tolist())
        now = frame.mesh.attributes["identity"].tolist()
        assert len(set(now)) == len(now) and set(now) <= alive
        assert frame.report.resampling is not None and frame.report.resampling.splits == len(births(frame))
        alive = set(now)
    assert told > len(alive)


def test_a_survivor_is_told_by_its_number_and_the_young_by_their_ancestors(motion: Motion) -> None:
    """A flow that only stretches: what the first frame's vertices were mixed to goes where they go."""
    stretching = resampled(motion, thresholds=Thresholds(EDGE, 1e-6), placement="chord")
    frames = list(animate(stretching, flow=lambda points, time, dt: points * (1 + dt)))
    found, first, last = descent(frames[2:]), frames[2].mesh, frames[-1].mesh
    stretch = (1 + 1 / 24) ** 17
    np.testing.assert_allclose(stretch * found.mixed(first.vertices), last.vertices, rtol=0, atol=1e-13)
    np.testing.assert_array_equal(found.survives, last.attributes["identity"] < frames[2].identities)
    assert found.survives.sum() == len(first.vertices) < len(last.vertices) / 1.5


def test_the_ancestors_of_a_wild_film_are_near_at_rest(motion: Motion) -> None:
    """Exact placement: survivors keep their points at rest, new ones lie by those they descend from."""
    frames = [
        MeshFrame.from_arrays(frame.to_arrays(), frame.number)
        for frame in animate(resampled(motion, min_roundness=0.0))
    ]
    found, then, now = descent(frames), frames[0].mesh.attributes["rest"], frames[-1].mesh.attributes["rest"]
    off = np.linalg.norm(found.mixed(then) - now, axis=1)
    assert off[found.survives].max() == 0
    assert 0 < np.count_nonzero(~found.survives) < len(now) and off.max() < EDGE


def test_frames_that_are_left_out_leave_no_lineage(motion: Motion) -> None:
    frames = list(animate(motion))
    with pytest.raises(UsageError, match=r"frames \[5, 7\] are not consecutive"):
        descent([frames[0], frames[2]])
    with pytest.raises(UsageError, match=r"frames \[\] are not"):
        descent([])


@needs_plugins("polyhedra")
def test_frames_of_polyhedra_have_no_lineage(motion: Motion) -> None:
    polygons = list(animate(resampled(motion, method="polyhedra", thresholds=Thresholds(1.2))))[:2]
    assert polygons[0].births is None and "births" not in polygons[0].to_arrays()
    with pytest.raises(UsageError, match="frame 5 has no identities"):
        descent(polygons)
