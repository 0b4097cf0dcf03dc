"""A surface refined for all frames: conforming at rest, fine enough in each frame, carried exactly."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.arrays import Floats
from flowsculpt.pipeline.errors import FrameError, UsageError
from flowsculpt.pipeline.flow.flow_map import FlowMap
from flowsculpt.pipeline.mesh import TriangleMesh
from flowsculpt.pipeline.mesh.normals import split_at_creases
from flowsculpt.pipeline.mesh.validation import validate
from flowsculpt.pipeline.plugins.interchange.exported_frame import exported_frame
from flowsculpt.pipeline.plugins.interchange.one_mesh import OneMesh
from flowsculpt.pipeline.plugins.interchange.refining import KIND, Refined, Refiner
from flowsculpt.pipeline.plugins.interchange.unifying import Unification
from flowsculpt.pipeline.production.request.render_request import RenderRequest
from flowsculpt.pipeline.production.store.store import Store
from tests.needed_plugins import needs_plugins, shot_rows
from tests.plugins.interchange.unified_shots import BALL, BOX, SHEET, TWIST, of_text, request_of, up_to

SLACK = 1.0 + 1e-9


def edges_of(mesh: TriangleMesh) -> tuple[np.ndarray, Floats]:
    """Return all edges (E, 2), and their lengths (E,)."""
    ends = np.concatenate([mesh.faces[:, [i, (i + 1) % 3]] for i in range(3)])
    return ends, np.linalg.norm(mesh.vertices[ends[:, 0]] - mesh.vertices[ends[:, 1]], axis=1)


def area(mesh: TriangleMesh) -> float:
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    return 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def require_fine(request: RenderRequest, refined: Refined) -> None:
    """Require that no edge is too long in any frame."""
    surface, _ = refined.surface()
    for number in request.requested:
        points, longest = refined.points_at(number), refined.lengths_at(number)
        ends, lengths = edges_of(TriangleMesh(points, surface.faces))
        assert (lengths <= SLACK * np.sqrt(longest[ends[:, 0]] * longest[ends[:, 1]])).all(), number


@settings(max_examples=8, deadline=None)
@given(st.floats(100.0, 400.0), st.sampled_from([0.4, 0.55, 0.8]), st.sampled_from([BOX, SHEET]))
def test_a_refined_flat_surface_is_the_same_surface_at_rest_with_no_long_edge_in_any_frame(
    turn: float, longest: float, subject: str
) -> None:
    with tempfile.TemporaryDirectory() as folder:
        request = request_of(Path(folder), subject, TWIST % (6, turn), f"{{max_edge_length: {longest}}}")
        refined = Refiner(request, Store(Path(folder))).refined()
        surface, _ = refined.surface()
        assert np.array_equal(surface.vertices[: len(refined.start.vertices)], refined.start.vertices)
        assert validate(surface).require().euler == validate(refined.start).require().euler
        assert validate(surface).require().boundary_edges >= validate(refined.start).require().boundary_edges
        assert area(surface) == pytest.approx(area(refined.start), rel=1e-12)
        assert crease_length(surface) == pytest.approx(crease_length(refined.start), rel=1e-12)
        require_fine(request, refined)


def crease_length(mesh: TriangleMesh) -> float:
    ends = mesh.vertices[np.unique(np.sort(mesh.creases, axis=1), axis=0)]
    return float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum())


FLOWS = {
    "vortex": "vortex: {axis: y, strength: 40, radius: 0.6}",
    "curl noise": "curl_noise: {strength: 2, size: 1.2, octaves: 1}",
    "twist": TWIST % (6, 300),
}


@needs_plugins("fields", "python")
@pytest.mark.parametrize("flow", FLOWS.values(), ids=FLOWS)
def test_each_vertex_lies_on_the_analytic_surface_at_rest_and_where_the_flow_carries_that_point(
    flow: str, tmp_path: Path
) -> None:
    request = request_of(tmp_path, BALL, flow)
    refined = Refiner(request, Store(tmp_path)).refined()
    surface, _ = refined.surface()
    assert len(refined.births)
    assert np.allclose(np.linalg.norm(surface.vertices, axis=1), 1.0, atol=1e-12)
    motion, history = request.shot.motion, FlowMap()
    for number in request.requested:
        if number > 1:
            history.add(motion.step_into(motion.flow, number))
        assert np.array_equal(refined.points_at(number), history.carry(surface.vertices)), number
    require_fine(request, refined)


@needs_plugins("fields")
def test_lengths_that_vary_bound_the_edges_of_each_frame(tmp_path: Path) -> None:
    lengths = "{max_edge_length: {curvature: {tolerance: 0.01, finest: 0.1, coarsest: 0.5}}}"
    request = request_of(tmp_path, BALL, FLOWS["curl noise"], lengths)
    refined = Refiner(request, Store(tmp_path)).refined()
    assert np.ptp(refined.lengths_at(6)) > 0.05
    require_fine(request, refined)


@needs_plugins("fields")
def test_an_interrupted_refinement_goes_on_with_the_same_bits(tmp_path: Path) -> None:
    request = request_of(tmp_path, BALL, FLOWS["curl noise"], "{max_edge_length: 0.3}")
    whole = Refiner(request, Store(tmp_path / "whole")).refined()
    store = Store(tmp_path / "stopped")
    for frames in (2, 5, 8):  # in the first sweep, and in the second
        passed = stopped_after(frames)
        with pytest.raises(KeyboardInterrupt):
            Refiner(request, store).refined(lambda name, total, passed=passed: passed)
    resumed = Refiner(request, store).refined()
    assert np.array_equal(resumed.births, whole.births)
    assert np.array_equal(resumed.surface()[0].faces, whole.surface()[0].faces)
    for number in request.requested:
        assert np.array_equal(resumed.points_at(number), whole.points_at(number))


def stopped_after(frames: int) -> Callable[[], None]:
    left = [frames]

    def passed() -> None:
        left[0] -= 1
        if not left[0]:
            raise KeyboardInterrupt

    return passed


def test_an_edit_of_a_late_key_keeps_the_frames_before_it(tmp_path: Path) -> None:
    store = Store(tmp_path)
    keys = "twist: {axis: y, amount: {ease: linear, keys: {1: 0, 4: 150, 6: %g}}}"
    before = Refiner(request_of(tmp_path, BOX, keys % 200), store)
    before.refined()
    edited = Refiner(request_of(tmp_path, BOX, keys % 320), store)
    assert edited.missing() == [5, 6]
    store_of_its_own = Store(tmp_path / "own")
    again = Refiner(request_of(tmp_path, BOX, keys % 320), store_of_its_own).refined()
    assert np.array_equal(edited.refined().points_at(6), again.points_at(6))


def test_moved_frames_have_the_points_and_normals_of_a_fresh_store(tmp_path: Path) -> None:
    """Both are kept by key: those of frame 3 in one shot are those of frame 5 in the other."""
    long = "vortex: {axis: y, centre: [0.5, 0, 0], radius: 1, strength: 2}"
    for folder, frames in (("used", "1-8"), ("used", "3-10"), ("fresh", "3-10")):
        mesh = Unification(
            request_of(tmp_path, BALL, long, frames=frames), Store(tmp_path / folder)
        ).one_mesh()
        found = [(mesh.frame(n).points.tobytes(), mesh.frame(n).normals.tobytes()) for n in mesh.frames]
        if folder == "used":
            moved = found
    assert moved == found


def test_fewer_frames_take_the_first_vertices_of_more(tmp_path: Path) -> None:
    request, store = request_of(tmp_path, BALL, FLOWS["twist"]), Store(tmp_path)
    whole = Refiner(request, store).refined()
    assert Refiner(up_to(request, 3), store).missing() == []
    part = Refiner(up_to(request, 3), store).refined()
    assert 0 < len(part.births) < len(whole.births)


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 100), st.sampled_from([BOX, BALL]))
def test_a_reduced_mesh_is_a_sound_surface_with_the_vertices_asked_for(share: int, subject: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        request, store = request_of(Path(folder), subject, TWIST % (6, 250)), Store(Path(folder))
        whole = Unification(request, store).one_mesh()
        least = len(Refiner(request, store).refined().start.vertices)
        wanted = least + share * (len(whole.rest) - least) // 100
        reduced = Unification(request, store, vertices=wanted).one_mesh()
        assert len(reduced.rest) == wanted
        assert validate(at_rest(reduced)).require().euler == 2
        assert is_subset(reduced.rest, whole.rest)
        if subject == BOX:
            assert area(at_rest(reduced)) == pytest.approx(24.0, rel=1e-12)
        points = reduced.frame(6).points
        assert is_subset(points, whole.frame(6).points)
        assert (reduced.reduction is None) == (wanted == len(whole.rest))


def at_rest(mesh: OneMesh) -> TriangleMesh:
    return TriangleMesh(mesh.rest, mesh.faces, creases=mesh.creases)


def is_subset(rows: Floats, all_rows: Floats) -> bool:
    return {row.tobytes() for row in rows} <= {row.tobytes() for row in all_rows}


def test_vertices_below_an_error_are_left_out_and_the_largest_error_is_reported(tmp_path: Path) -> None:
    request, store = request_of(tmp_path, BALL, FLOWS["twist"]), Store(tmp_path)
    sizes, errors = [], []
    for until in (0.15, 0.25, 0.4):
        mesh = Unification(request, store, until=until).one_mesh()
        assert mesh.reduction is not None
        assert mesh.reduction.error < until
        sizes.append(len(mesh.rest))
        errors.append(mesh.reduction.error)
        assert mesh.reduction.whole > len(mesh.rest)
        assert mesh.reduction.frame in mesh.frames
    assert sizes == sorted(sizes, reverse=True)
    assert errors == sorted(errors)
    assert Unification(request, store, until=0.0).one_mesh().reduction is None


def test_each_subject_has_its_own_mesh_and_copies_keep_apart(tmp_path: Path) -> None:
    text = """\
title: Two
frames: 1-3
subjects:
  post: {solid: box, size: [1, 2, 1], place: [-2, 0, 0]}
  beads: {solid: icosphere, radius: 0.3, copies: {count: 3, seed: 1, region: {sphere: {radius: 2}}}}
resample: {max_edge_length: 0.3}
flows: [twist: {axis: y, amount: {ease: linear, keys: {1: 0, 3: 150}}}]
"""
    request, store = of_text(tmp_path, text), Store(tmp_path)
    post, beads = (Unification(part, store).one_mesh() for part in request.parts)
    assert (post.name, beads.name) == ("post", "beads")
    assert validate(at_rest(post)).require().euler == 2
    assert validate(at_rest(beads)).require().euler == 6


def test_the_mesh_of_rigid_copies_is_that_of_their_frames(tmp_path: Path) -> None:
    text = """\
title: Beads
frames: 1-4
subjects:
  beads:
    solid: box
    size: [0.3, 0.1, 0.2]
    copies: {count: 3, seed: 1, rigid: true, size: [0.5, 2], region: {sphere: {radius: 2}}}
    look: {material: clay, pigment: {palette: {colours: [[1, 0, 0], [0, 0, 1]], seed: 1}}}
resample: {max_edge_length: 0.1}
flows: [vortex_ring: {radius: 1, strength: 5}]
"""
    request, store = of_text(tmp_path, text), Store(tmp_path)
    part = next(iter(request.parts))
    mesh = Unification(part, store).one_mesh()
    for frame in animate(part.shot.motion):
        shown, exported = mesh.frame(frame.number), exported_frame(part.shot, frame)
        assert np.array_equal(shown.points, frame.mesh.vertices)
        assert np.array_equal(exported.points, frame.mesh.vertices)
        assert exported.copies is not None and np.array_equal(np.unique(exported.copies), [1, 2, 3])
        assert np.allclose(shown.velocities, exported.velocities)
        own = frame.mesh.vertices.reshape(3, -1, 3) - frame.copies.origins[:, None]
        assert ((exported.normals[: len(shown.points)].reshape(own.shape) * own).sum(axis=2) > 0).all()
    assert mesh.colours is not None and exported.colours is not None
    assert np.array_equal(mesh.colours, exported.colours) and np.ptp(mesh.colours[:, 1]) == 0
    edges = mesh.creases.shape[0]
    assert edges == len(frame.mesh.creases) > 0
    with pytest.raises(UsageError, match="vertices at rest"):
        Unification(part, store, vertices=10).one_mesh()


def test_normals_are_carried_by_the_flow_from_the_surface_at_rest(tmp_path: Path) -> None:
    stretch = "stretch: {axis: y, amount: {ease: linear, keys: {1: 1, 6: 2}}}"
    request, store = request_of(tmp_path, BALL, stretch, "{max_edge_length: 0.3}"), Store(tmp_path)
    mesh = Unification(request, store).one_mesh()
    scale = (mesh.frame(6).points * mesh.rest).sum(axis=0) / (mesh.rest**2).sum(axis=0)
    across = mesh.rest / scale
    exact = across / np.linalg.norm(across, axis=1, keepdims=True)
    assert scale[1] == pytest.approx(2.0)
    assert np.degrees(np.arccos(np.einsum("ij,ij->i", mesh.frame(6).normals, exact).clip(-1, 1))).max() < 0.02
    again = Unification(request, store).one_mesh()
    assert np.array_equal(again.frame(4).normals, mesh.frame(4).normals), "stored and computed are the same"


def test_a_subject_that_is_not_resampled_is_its_own_mesh(tmp_path: Path) -> None:
    request = request_of(tmp_path, BOX, TWIST % (6, 90), "off")
    mesh = Unification(request, Store(tmp_path)).one_mesh()
    assert np.array_equal(mesh.rest, request.shot.motion.mesh_at_rest().vertices)
    assert crease_length(at_rest(mesh)) == pytest.approx(24.0)
    assert len(mesh.frame(6).normals) == len(split_at_creases(at_rest(mesh)).vertices)


CODE = """\
import numpy as np

def torn(points, time, dt):
    return points + dt * np.sign(points[:, :1]) * (40.0, 0.0, 0.0)

def crowd(points, time, dt):
    return points + dt * (points - points.mean(axis=0))
"""


def with_code(folder: Path, function: str) -> RenderRequest:
    (folder / "code.py").write_text(CODE)
    return request_of(folder, BOX, f"python: {{file: code.py, function: {function}}}")


@needs_plugins("fields", "python")
def test_a_flow_that_tears_the_surface_is_refused_at_its_frame(tmp_path: Path) -> None:
    with pytest.raises(
        FrameError, match=r"^frame 2: the flow tears the surface at \(.*\) at rest"
    ) as refused:
        Refiner(with_code(tmp_path, "torn"), Store(tmp_path)).refined()
    assert "\n" not in str(refused.value)


@needs_plugins("fields", "python")
def test_a_flow_that_moves_points_by_others_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(FrameError, match=r"^frame 2: flow .* moves a point alone elsewhere"):
        Refiner(with_code(tmp_path, "crowd"), Store(tmp_path)).refined()


def test_more_vertices_than_the_budget_are_refused_at_their_frame(tmp_path: Path) -> None:
    request = request_of(tmp_path, BOX, TWIST % (6, 400), "{max_edge_length: 0.5, max_vertices: 150}")
    with pytest.raises(FrameError, match=r"^frame \d: .* the budget of 150 vertices.*choose frames before"):
        Refiner(request, Store(tmp_path)).refined()


@pytest.mark.parametrize(
    ("subject", "resample", "says"),
    shot_rows(
        [
            (
                "{cloud: {solid: icosphere, radius: 1}, count: 9, radius: 0.1}",
                "off",
                "points and control nets have no triangles",
            ),
            (BOX, "{max_edge_length: 0.5, method: polyhedra}", "write method: triangles"),
            (BOX, "{max_edge_length: 0.5, placement: chord}", "write placement: exact"),
        ]
    ),
)
def test_subjects_without_one_mesh_are_refused(
    subject: str, resample: str, says: str, tmp_path: Path
) -> None:
    with pytest.raises(UsageError, match=says):
        Unification(request_of(tmp_path, subject, TWIST % (6, 90), resample), Store(tmp_path))


def test_fewer_vertices_than_at_rest_are_refused(tmp_path: Path) -> None:
    request = request_of(tmp_path, BALL, FLOWS["twist"])
    with pytest.raises(
        UsageError, match=r"T010_refined has \d+ vertices at rest, so one mesh of it cannot have 10"
    ):
        Unification(request, Store(tmp_path), vertices=10).one_mesh()


def test_a_damaged_file_is_made_again_by_the_next_run(tmp_path: Path) -> None:
    request, store = request_of(tmp_path, BALL, FLOWS["twist"]), Store(tmp_path)
    refiner = Refiner(request, store)
    whole = refiner.refined().points_at(6)
    path = next(path for kind, _, path in store.entries() if kind == KIND)
    path.chmod(0o644)
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(FrameError, match="is damaged; run again"):
        Refiner(request, store).refined()
    assert np.array_equal(Refiner(request, store).refined().points_at(6), whole)
