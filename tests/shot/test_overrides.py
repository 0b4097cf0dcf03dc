"""Every setting under `resample` acts on the frames, or is no part of what they are made from."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.animation import MeshFrame, animate
from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.mesh import read_mesh, read_polygons, validate
from flowsculpt.pipeline.resample import PolygonReport
from flowsculpt.pipeline.shot import Motion, read_shot
from tests.needed_plugins import missing, needed_in, needs_plugins, shot_rows

SHOT = """\
title: Box
frames: 1-5
subject: {solid: box, size: [2, 1.6, 1.2]}
resample: {%s}
flows:
  - vortex: {axis: z, centre: [0.7, 0, 0], radius: 0.8, strength: 26}
  - rotation: {speed: 80, axis: x}
  - twist: {amount: {ease: linear, keys: {1: 0, 5: 120}}}
"""

LENGTHS = "{curvature: {tolerance: 0.01, finest: 0.2, coarsest: 0.6}}"
CAMERA = "{camera: {position: [%s, 0, 4], pixels: 150, finest: 0.2, coarsest: 0.8}}"


@pytest.fixture(autouse=True, scope="module")
def one_thread() -> Iterator[None]:
    """A few hundred points are not worth sharing: on busy cores waiting for a second thread takes longest."""
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    yield
    numba.set_num_threads(before)


@cache
def motion(resample: str, frames: str = "1-5", subject: str | None = None) -> Motion:
    text = (SHOT % resample).replace("1-5", frames)
    if subject is not None:
        text = text.replace("{solid: box, size: [2, 1.6, 1.2]}", subject)
    return read_shot(Path("/nowhere/a.yaml"), text).motion


@cache
def frames_of(resample: str) -> tuple[MeshFrame, ...]:
    return tuple(animate(motion(resample)))


def bits(frames: tuple[MeshFrame, ...]) -> list[dict[str, bytes]]:
    return [{name: array.tobytes() for name, array in frame.to_arrays().items()} for frame in frames]


def data(resample: str) -> str:
    found = motion(resample)
    return json.dumps([found.start_data(), *map(found.step_data, found.frames.numbers[1:])])


POLYHEDRA = "max_edge_length: 0.6, method: polyhedra"
CHORD = "max_edge_length: 0.4, placement: chord"

ACTING = [
    ("max_edge_length: 0.4", "max_edge_length: 0.35"),
    ("max_edge_length: 0.4", "max_edge_length: {keys: {1: 0.4, 5: 0.35}}"),
    ("max_edge_length: {formula: 0.4 + 0.01 * x}", "max_edge_length: {formula: 0.4 + 0.05 * x}"),
    (f"max_edge_length: {LENGTHS}", f"max_edge_length: {LENGTHS.replace('0.01', '0.002')}"),
    (f"max_edge_length: {CAMERA % 0}", f"max_edge_length: {CAMERA % 3}"),
    ("max_edge_length: 0.4", "max_edge_length: 0.4, min_edge_length: 0.05"),
    ("max_edge_length: 0.4", "max_edge_length: 0.4, min_edge_length: {formula: 0.05 + 0.05 * abs(x)}"),
    ("max_edge_length: 0.4, min_edge_length: {keys: {1: 0.1, 5: 0.15}}", "max_edge_length: 0.4"),
    ("max_edge_length: 0.4", "max_edge_length: 0.4, hard_angle: 100"),
    (f"{CHORD}, creases: none", f"{CHORD}, creases: none, hard_angle: 15"),
    (f"{CHORD}, creases: none", f"{CHORD}, creases: none, hard_angle: {{keys: {{1: 100, 5: 40}}}}"),
    ("max_edge_length: 0.4", "max_edge_length: 0.4, hard_angle: {formula: 95 + 50 * x}"),
    (f"max_edge_length: {LENGTHS}", f"max_edge_length: {LENGTHS}, gradation: 0.05"),
    ("max_edge_length: 0.4", "max_edge_length: 0.4, method: polyhedra"),
    ("max_edge_length: 0.4", CHORD),
    ("max_edge_length: 0.4", "max_edge_length: 0.4, placement: curved"),
    (CHORD, "max_edge_length: 0.4, placement: curved"),
    (CHORD, f"{CHORD}, splits: faces"),
    ("max_edge_length: 0.4", "max_edge_length: 0.4, min_roundness: 0"),
    ("max_edge_length: 0.4", "max_edge_length: 0.4, min_roundness: 0.85"),
    (CHORD, f"{CHORD}, min_roundness: 0"),
    ("max_edge_length: 0.4, placement: curved", "max_edge_length: 0.4, placement: curved, min_roundness: 0"),
    ("max_edge_length: 0.4", "max_edge_length: 0.4, normals: geometric"),
    ("max_edge_length: 0.4", "max_edge_length: 0.4, rest_interval: 3"),
    ("max_edge_length: 0.4", "max_edge_length: 0.4, creases: none"),
    (CHORD, f"{CHORD}, creases: none"),
    ("max_edge_length: 0.4", "max_edge_length: 0.4, creases: {formula: abs(y) < 0.3}"),
    (POLYHEDRA, POLYHEDRA.replace("0.6", "0.5")),
    (POLYHEDRA, f"{POLYHEDRA}, min_edge_length: 0.05"),
    (POLYHEDRA, f"{POLYHEDRA}, creases: none"),
    (f"{POLYHEDRA}, creases: none", f"{POLYHEDRA}, creases: none, hard_angle: 100"),
    (POLYHEDRA, f"{POLYHEDRA}, creases: {{formula: x > 0}}"),
    (POLYHEDRA, f"{POLYHEDRA}, cutting: recurse"),
    (POLYHEDRA, f"{POLYHEDRA}, collapse: areas"),
    (POLYHEDRA, POLYHEDRA.replace("0.6", "{formula: 0.6 + 0.1 * x}")),
]


@pytest.mark.parametrize(
    ("one", "other"), shot_rows(ACTING), ids=[f"{one} or {other}" for one, other in ACTING]
)
def test_a_setting_changes_the_frames_and_their_keys(one: str, other: str) -> None:
    assert bits(frames_of(one)) != bits(frames_of(other))
    shapes = [f.mesh.vertices.tobytes() + f.mesh.creases.tobytes() for f in frames_of(one)]
    others = [f.mesh.vertices.tobytes() + f.mesh.creases.tobytes() for f in frames_of(other)]
    kept = [sorted(frames_of(settings_)[-1].mesh.attributes) for settings_ in (one, other)]
    assert shapes != others or kept[0] != kept[1], "more than the report differs"
    assert data(one) != data(other)


IDLE = [
    # cutting and collapse are settings of polyhedra
    ("max_edge_length: 0.4", "max_edge_length: 0.4, cutting: recurse, collapse: areas"),
    (CHORD, f"{CHORD}, normals: geometric, rest_interval: 2, cutting: recurse, collapse: areas"),
    ("max_edge_length: 0.4", "max_edge_length: 0.4, max_vertices: 5000"),
    ("max_edge_length: 0.4", "max_edge_length: 0.4, gradation: 0.05"),
    ("max_edge_length: 0.4", "max_edge_length: 0.4, rest_interval: 5"),
    ("max_edge_length: 0.4, creases: none", "max_edge_length: 0.4, creases: none, hard_angle: 15"),
    (
        POLYHEDRA,
        f"{POLYHEDRA}, placement: curved, splits: faces, min_roundness: 0.9, normals: geometric, "
        "rest_interval: 2",
    ),
]


@pytest.mark.parametrize(
    ("one", "other"),
    [*(pytest.param(*row, marks=needs_plugins("polyhedra")) for row in IDLE[:2]), *shot_rows(IDLE[2:])],
    ids=[other for _, other in IDLE],
)
def test_a_setting_that_cannot_act_is_no_part_of_the_keys(one: str, other: str) -> None:
    assert data(one) == data(other)
    assert bits(frames_of(one)) == bits(frames_of(other))


CREASED = """\
v 0 0 0
v 1 0 0
v 1 0 1
v 0 0 1
v 2 0 0
v 2 0 1
g left
f 1 4 3 2
g right
f 2 3 6 5
"""


@needs_plugins("interchange")
@pytest.mark.parametrize("method", shot_rows(["triangles", "polyhedra"]))
def test_the_creases_of_a_models_file_are_kept(tmp_path: Path, method: str) -> None:
    """A flat sheet of two groups: nothing but their border is a crease, and only where the file counts."""
    (tmp_path / "two.obj").write_text(CREASED)
    assert len(read_mesh(tmp_path / "two.obj").creases) == 1

    def creases(source: str) -> Any:
        resample = f"max_edge_length: 0.3, method: {method}, creases: {source}"
        text = (SHOT % resample).replace("{solid: box, size: [2, 1.6, 1.2]}", "{model: two.obj}")
        mesh = next(animate(read_shot(tmp_path / "a.yaml", text))).mesh
        return mesh.vertices[mesh.creases]

    assert len(creases("rest")) == len(creases("none")) == 0
    border = creases("model")
    assert len(border) >= 4 and (border[..., 0] == 1.0).all()
    assert np.linalg.norm(np.diff(border, axis=1), axis=2).sum() == pytest.approx(1.0)


@pytest.mark.parametrize("placement", ["exact", "curved", "chord"])
def test_without_creases_nothing_is_tagged(placement: str) -> None:
    for frame in frames_of(f"max_edge_length: 0.4, placement: {placement}, creases: none"):
        assert not len(frame.mesh.creases)


@needs_plugins("polyhedra")
def test_polyhedra_begin_with_the_subjects_own_polygons() -> None:
    """P20: six quadrilaterals are sliced on the first frame."""
    assert list(motion(POLYHEDRA).polygons_at_rest().sides) == [4] * 6
    assert len(motion(POLYHEDRA, subject="{solid: sheet, size: [2, 1]}").polygons_at_rest()) == 1
    ball = motion(POLYHEDRA, subject="{solid: icosphere}")
    assert np.array_equal(ball.polygons_at_rest().triangulated().faces, ball.mesh_at_rest().faces)
    first = frames_of(POLYHEDRA)[0]
    assert first.polygons is not None
    np.testing.assert_allclose(first.polygons.bounds, [[-1.0, -0.8, -0.6], [1.0, 0.8, 0.6]])
    assert first.polygons.average_sides > 3.5
    assert isinstance(first.report.resampling, PolygonReport) and first.report.resampling.cuts > 20


@needs_plugins("interchange", "polyhedra")
def test_a_models_polygons_are_kept_and_scaled(tmp_path: Path) -> None:
    (tmp_path / "two.obj").write_text(CREASED)
    text = (SHOT % POLYHEDRA).replace("{solid: box, size: [2, 1.6, 1.2]}", "{model: two.obj, scale: 0.2}")
    at_rest = read_shot(tmp_path / "a.yaml", text).motion.polygons_at_rest()
    np.testing.assert_array_equal(at_rest.vertices, 0.2 * read_polygons(tmp_path / "two.obj").vertices)
    assert list(at_rest.sides) == [4, 4]


@needs_plugins("polyhedra")
def test_functions_over_polyhedra_are_asked_on_a_fine_solid() -> None:
    """Eight corners of a box could not tell that it is to be finer in between."""
    text = "max_edge_length: {formula: 0.15 + 0.5 * abs(x)}, method: polyhedra"
    first = next(animate(motion(text)))
    x = first.mesh.vertices[first.mesh.faces].mean(axis=1)[:, 0]
    assert (np.abs(x) < 0.25).sum() > 2 * (np.abs(x) > 0.75).sum() > 0


@needs_plugins("polyhedra")
@pytest.mark.parametrize("settings_", ["", ", cutting: recurse, collapse: areas"])
def test_polygons_stay_a_surface_in_the_bracket_and_shown_by_triangles(settings_: str) -> None:
    for frame in frames_of(POLYHEDRA + settings_):
        polygons, mesh = frame.polygons, frame.mesh
        assert polygons is not None
        assert validate(polygons).require(closed=True).euler == 2 and validate(mesh).closed
        np.testing.assert_array_equal(mesh.vertices[: len(polygons.vertices)], polygons.vertices)
        np.testing.assert_array_equal(mesh.creases, polygons.creases)
        ends = polygons.vertices[polygons.edges]
        assert np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).max() <= 0.6 * (1 + 1e-12)
        assert polygons.extents.max() <= 0.6 * (1 + 1e-12)
    assert bits(frames_of(POLYHEDRA))[-1]["corners"] != bits(frames_of(POLYHEDRA))[0]["corners"]


RESUMED = [
    "max_edge_length: 0.4, rest_interval: 3",
    f"{CHORD}, splits: faces",
    f"{CHORD}, splits: faces, creases: {{formula: x > 0}}",
    "max_edge_length: {formula: 0.4 + 0.05 * x}, placement: chord, splits: faces",
    POLYHEDRA,
    f"{POLYHEDRA}, cutting: recurse, collapse: areas",
    POLYHEDRA.replace("0.6", "{keys: {1: 0.7, 5: 0.5}}"),
]


@given(st.sampled_from([each for each in RESUMED if not missing(*needed_in(each))]), st.integers(0, 3))
@settings(deadline=None, max_examples=30)
def test_a_run_goes_on_from_any_frame_with_the_same_bits(resample: str, stop: int) -> None:
    through = frames_of(resample)
    kept = MeshFrame.from_arrays(through[stop].to_arrays(), through[stop].number)
    assert kept.report == through[stop].report
    assert type(kept.report.resampling) is type(through[stop].report.resampling)
    assert bits(tuple(animate(motion(resample), resume=kept))) == bits(through[stop + 1 :])


@needs_plugins("polyhedra")
def test_a_frame_of_triangles_is_no_start_for_polyhedra() -> None:
    with pytest.raises(UsageError, match="frame 1 has no polygons to continue with method polyhedra"):
        next(animate(motion(POLYHEDRA), resume=frames_of(CHORD)[0]))


def test_faces_cut_in_four_are_counted() -> None:
    reports = [frame.report.resampling for frame in frames_of(f"{CHORD}, splits: faces")]
    assert sum(report.splits for report in reports if report) > 50
    assert all(report and report.too_long == 0 and report.longest <= 0.4 * (1 + 1e-12) for report in reports)
