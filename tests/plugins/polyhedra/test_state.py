"""A film of polyhedra can stop at any frame and go on, bit for bit; what cannot be done is said."""

from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.errors import FrameError, MeshError, UsageError
from flowsculpt.pipeline.mesh import PolygonMesh, validate
from flowsculpt.pipeline.plugins.polyhedra.polyhedral_resampler import PolyhedralResampler
from flowsculpt.pipeline.plugins.polyhedra.polyhedron import Cutting
from flowsculpt.pipeline.resample import Thresholds

THRESHOLDS = Thresholds(0.35)


def begin(cube: PolygonMesh) -> PolyhedralResampler:
    named = {"rest": cube.vertices, "mark": np.arange(8) % 3, "heat": cube.vertices[:, 0]}
    return PolyhedralResampler(
        PolygonMesh.from_arrays(cube.vertices, cube.offsets, cube.corners, named, [(0, 1), (4, 5)]),
        THRESHOLDS,
    )


def advance(resampler: PolyhedralResampler, frames: range) -> None:
    for frame in frames:
        x, y, z = resampler.vertices.T.copy()
        resampler.vertices[:] = np.column_stack(
            [x + 0.06 * np.sin(2 * y + frame), y + 0.05 * np.sin(3 * z), z * 1.01]
        )
        resampler.resample()


def digest(resampler: PolyhedralResampler) -> dict[str, bytes]:
    return {name: values.tobytes() for name, values in resampler.state().items()}


def test_resuming_from_a_saved_frame_gives_the_same_bits_as_never_stopping(
    menagerie: dict[str, PolygonMesh], tmp_path: Path
) -> None:
    straight = begin(menagerie["cube"])
    advance(straight, range(24))
    stopped = begin(menagerie["cube"])
    advance(stopped, range(11))
    np.savez(tmp_path / "frame.0011.npz", **stopped.state())
    with np.load(tmp_path / "frame.0011.npz") as saved:
        resumed = PolyhedralResampler.from_state(saved, THRESHOLDS)
    advance(resumed, range(11, 24))
    assert digest(resumed) == digest(straight)
    assert len(straight.mesh.creases) > 10


def test_a_state_without_faces_cannot_be_resumed() -> None:
    with pytest.raises(UsageError, match="has no offsets and no corners"):
        PolyhedralResampler.from_state({"vertices": np.eye(3)}, THRESHOLDS)


def test_attributes_are_interpolated_on_the_way(menagerie: dict[str, PolygonMesh]) -> None:
    """Attributes that are linear in space stay so, whatever is cut or merged; marks are never mixed."""
    resampler = begin(menagerie["cube"])
    splits = collapses = 0
    for _ in range(8):
        resampler.vertices[:] *= [1.2, 0.85, 0.85]
        report = resampler.resample()
        splits, collapses = splits + report.splits, collapses + report.collapses
    assert splits > 100
    assert collapses > 100
    mesh = resampler.mesh
    assert np.allclose(mesh.attributes["rest"] * [1.2**8, 0.85**8, 0.85**8], mesh.vertices)
    assert mesh.attributes["mark"].dtype.kind == "i"
    assert set(np.unique(mesh.attributes["mark"])) <= {0, 1, 2}


def test_a_frame_over_the_budget_stops_and_leaves_the_surface_sound(
    menagerie: dict[str, PolygonMesh],
) -> None:
    resampler = PolyhedralResampler(menagerie["ball"], Thresholds(0.3, max_vertices=900))
    resampler.vertices[:] *= 50
    with pytest.raises(FrameError, match=r"exceed the budget of 900 vertices; raise max_vertices"):
        resampler.resample()
    assert validate(resampler.mesh).require(closed=True).euler == 2
    assert len(resampler.vertices) <= 900


@pytest.mark.parametrize("wild", [np.nan, np.inf, 1e300])
def test_a_vertex_that_is_not_finite_stops_the_frame(wild: float, menagerie: dict[str, PolygonMesh]) -> None:
    resampler = PolyhedralResampler(menagerie["ball"], THRESHOLDS)
    resampler.vertices[17, 1] = wild
    with pytest.raises(FrameError, match=r"vertex 17 is at .*not finite"):
        resampler.resample()


def test_a_polyhedron_within_its_length_limits_is_left_alone(menagerie: dict[str, PolygonMesh]) -> None:
    resampler = begin(menagerie["cube"])
    resampler.resample()
    before = digest(resampler)
    report = resampler.resample()
    assert (report.splits, report.cuts, report.collapses, report.passes) == (0, 0, 0, 0)
    assert digest(resampler) == before


def test_ways_that_do_not_exist_are_refused(menagerie: dict[str, PolygonMesh]) -> None:
    with pytest.raises(UsageError, match="cutting 'dice' is not known"):
        PolyhedralResampler(menagerie["cube"], THRESHOLDS, cutting="dice")  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="collapse 'volumes' is not known"):
        PolyhedralResampler(menagerie["cube"], THRESHOLDS, collapse="volumes")  # type: ignore[arg-type]
    with pytest.raises(MeshError, match="the mesh has no faces"):
        PolyhedralResampler(PolygonMesh(np.eye(3), []), THRESHOLDS)


def test_an_edge_stretched_beyond_all_bounds_stops_the_frame_at_once(
    menagerie: dict[str, PolygonMesh],
) -> None:
    for cutting in ("slice", "recurse"):
        resampler = PolyhedralResampler(menagerie["cube"], THRESHOLDS, cutting)  # type: ignore[arg-type]
        resampler.vertices[0] = (1e30, 0, 0)
        with pytest.raises(FrameError, match=r"exceed the budget|nearer to the origin"):
            resampler.thresholds = Thresholds(0.35, max_vertices=1000)
            resampler.resample()
        assert validate(resampler.mesh).require(closed=True).euler == 2


@pytest.mark.parametrize("cutting", ["slice", "recurse"])
def test_a_surface_too_far_out_to_be_cut_is_refused(
    cutting: Cutting, menagerie: dict[str, PolygonMesh]
) -> None:
    """Between 2^53 and the next number there is nothing."""
    points = menagerie["leaf"].vertices * 1.5 + 2.0**53
    resampler = PolyhedralResampler(menagerie["leaf"].with_vertices(points), Thresholds(1.5), cutting)
    with pytest.raises(FrameError, match="nearer to the origin"):
        resampler.resample()
    assert validate(resampler.mesh).require().euler == 1
