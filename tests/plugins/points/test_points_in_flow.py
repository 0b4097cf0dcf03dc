"""P4: a flow moves particles and control points as it moves the vertices of a mesh."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.animation import MeshFrame, animate, descent, mesh_at_subframe
from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.flow import Flow, Sequence, Streamlines, keyed
from flowsculpt.pipeline.flow.catalogue.deformations import Twist
from flowsculpt.pipeline.flow.catalogue.lorenz import Lorenz
from flowsculpt.pipeline.frames import FrameRange, FrameRate
from flowsculpt.pipeline.mesh.control_net import Lattice, bspline_surface
from flowsculpt.pipeline.plugins.points.clouds import CloudInSolid
from flowsculpt.pipeline.plugins.points.nets import NetOfSolid
from flowsculpt.pipeline.resample import Thresholds
from flowsculpt.pipeline.shot import Motion, Resampling, Solid
from flowsculpt.pipeline.shot.subjects import Subject

CLOUD = CloudInSolid(Solid.of("torus", {}), 200, "volume", 4, 0.02)
NET = NetOfSolid.of("tube", {"length": 2.0}, 6, 8)
FLOW = Sequence(
    (
        Streamlines(Lorenz(scale=16.0, time_scale=keyed((0.0, 0.2), (0.0, 0.3)))),
        Twist(amount=keyed((0.0, 0.4), (0.0, 1.0))),
    )
)


def motion(subject: Subject, flow: Flow = FLOW, resampling: Resampling | None = None) -> Motion:
    return Motion(FrameRange.parse("3-9"), FrameRate.of(24), subject, flow, resampling)


def same(one: MeshFrame, other: MeshFrame) -> bool:
    mine, theirs = one.to_arrays(), other.to_arrays()
    return mine.keys() == theirs.keys() and all(
        a.dtype == theirs[name].dtype and a.tobytes() == theirs[name].tobytes() for name, a in mine.items()
    )


@pytest.mark.parametrize("subject", [CLOUD, NET])
def test_the_points_of_a_frame_are_where_the_flow_takes_those_of_the_frame_before(subject: Subject) -> None:
    shot = motion(subject)
    frames = list(animate(shot))
    assert [frame.number for frame in frames] == list(range(3, 10))
    for before, after in pairwise(frames):
        time, dt = shot.clock.step(after.number)
        moved = shot.flow.displace(before.mesh.vertices, time, dt)
        assert np.array_equal(after.mesh.vertices, moved)


@settings(max_examples=10, deadline=None)
@given(st.lists(st.integers(0, 199), min_size=1, max_size=40, unique=True))
def test_a_cloud_flows_as_each_of_its_points_would_alone(chosen: list[int]) -> None:
    """A point's neighbours do not change its path, to the last bit."""
    whole = list(animate(motion(CLOUD)))[-1].mesh.vertices
    points = next(animate(motion(CLOUD))).mesh.vertices[chosen]
    shot = motion(CLOUD)
    for frame in range(4, 10):
        points = shot.flow.displace(points, *shot.clock.step(frame))
    assert np.array_equal(points, whole[chosen])


@pytest.mark.parametrize("subject", [CLOUD, NET])
def test_going_on_from_any_frame_of_a_file_gives_the_same_bits(subject: Subject, tmp_path: Path) -> None:
    shot = motion(subject)
    frames = list(animate(shot))
    for k in (0, 3):
        np.savez(tmp_path / "kept.npz", **frames[k].to_arrays())  # type: ignore[arg-type]
        with np.load(tmp_path / "kept.npz") as kept:
            stored = MeshFrame.from_arrays({name: kept[name] for name in kept.files}, frames[k].number)
        assert same(stored, frames[k])
        rest = list(animate(shot, resume=stored))
        assert len(rest) == 6 - k
        assert all(same(a, b) for a, b in zip(rest, frames[k + 1 :], strict=True))


def test_a_cloud_keeps_its_radii_its_identities_and_has_no_faces() -> None:
    for frame in animate(motion(CLOUD)):
        assert frame.mesh.faces.shape == (0, 3)
        assert (frame.mesh.attributes["radius"] == 0.02).all()
        assert np.array_equal(frame.mesh.attributes["identity"], np.arange(200))
        assert frame.report.statistics is None
        assert frame.lattice is None


def test_where_points_come_from_is_known_as_it_is_of_vertices() -> None:
    frames = list(animate(motion(CLOUD)))
    assert np.array_equal(descent(frames).mixed(frames[0].mesh.vertices), frames[0].mesh.vertices)


def test_a_net_keeps_its_layout_and_says_how_mesh_like_it_is() -> None:
    for frame in animate(motion(NET)):
        assert frame.lattice == Lattice(6, 8, (False, True))
        assert frame.report.statistics is not None


def test_a_net_under_an_affine_flow_has_the_moved_surface() -> None:
    """Only affine flows commute with the blend; under others the net is the animator's handle."""

    def sheared(points: np.ndarray, time: float, dt: float) -> np.ndarray:
        return points + dt * points[:, 1:2] * np.array([1.0, 0.0, 0.0])

    first, second, *_ = animate(motion(NET), flow=sheared)
    assert first.lattice is not None
    before = bspline_surface(first.mesh.vertices, first.lattice).vertices
    after = bspline_surface(second.mesh.vertices, first.lattice).vertices
    assert after == pytest.approx(sheared(before, 0.0, 1 / 24), abs=1e-13)


def test_points_between_frames_are_where_the_flow_has_them() -> None:
    shot = motion(CLOUD)
    frames = list(animate(shot))
    assert mesh_at_subframe(shot, frames[2], 6.0).vertices == pytest.approx(
        frames[3].mesh.vertices, abs=1e-12
    )


@pytest.mark.parametrize("subject", [CLOUD, NET])
def test_points_cannot_be_resampled(subject: Subject) -> None:
    with pytest.raises(UsageError, match="are not resampled"):
        next(animate(motion(subject, resampling=Resampling(Thresholds(max_edge_length=0.1)))))


def test_arrays_whose_net_is_of_other_points_are_no_frame() -> None:
    arrays = next(animate(motion(NET))).to_arrays()
    with pytest.raises(UsageError, match="a net of 30 points has 48"):
        MeshFrame.from_arrays({**arrays, "net": Lattice(5, 6).as_array()}, 1)
