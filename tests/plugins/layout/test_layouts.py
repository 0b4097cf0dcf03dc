"""Layouts of copies, and copies that differ in size and turn."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.errors import ShotError
from flowsculpt.pipeline.mesh import TriangleMesh, icosphere
from flowsculpt.pipeline.plugins.layout.copy_layouts import frames, refined
from flowsculpt.pipeline.shot import Motion, read_shot
from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.scene.patterns import Pigment
from flowsculpt.render.scene.surface import Surface
from tests.needed_plugins import shot_rows

SHOT = """
title: Tiles
frames: 1-2
subjects:
  tiles: {solid: box, size: [0.1, 0.02, 0.2], copies: {COPIES, rigid: true}}
resample: {max_edge_length: 0.1}
"""


GRID = "{grid: {cells: [2, 3, 4], spacing: [1, 2, 3], centre: [0, 5, 0]}}"


JITTERED = GRID[:-1] + ", jitter: [0.3, 0, 0.1]}"


def motion_of(copies: str, where: Path = Path("a.yaml")) -> Motion:
    return read_shot(where, SHOT.replace("COPIES", copies)).subjects[0].motion


def placed(copies: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the middles (N, 3) of copies, and their axes (N, 3, 3) times their sizes."""
    _, placements = motion_of(copies).of_shape()
    return placements.origins, placements.matrices[:, :, :3]


@given(st.integers(0, 2**31))
def test_frames_are_rotations_that_turn_y_up(seed: int) -> None:
    up = np.random.default_rng(seed).standard_normal((5, 3))
    up = np.concatenate([up / np.linalg.norm(up, axis=1)[:, None], np.eye(3), -np.eye(3)])
    turns = frames(up, np.broadcast_to((1.0, 0.0, 0.0), up.shape))
    assert np.allclose(turns @ turns.swapaxes(1, 2), np.eye(3), atol=1e-12)
    assert np.allclose(np.linalg.det(turns), 1.0) and np.allclose(turns[:, :, 1], up)


def test_a_grid_fills_rows_around_its_centre() -> None:
    middles, axes = placed(
        "count: 24, layout: {grid: {cells: [2, 3, 4], spacing: [1, 2, 3], centre: [0, 5, 0]}}"
    )
    assert np.allclose(middles.mean(axis=0), (0, 5, 0)) and np.allclose(np.ptp(middles, axis=0), (1, 4, 9))
    assert len(np.unique(middles.round(6), axis=0)) == 24 and np.allclose(axes, np.eye(3))


def test_jitter_moves_places_by_chance_along_its_axes() -> None:
    (even, _), (moved, _) = placed(f"count: 24, layout: {GRID}"), placed(f"count: 24, layout: {JITTERED}")
    assert (np.abs(moved - even) <= (0.3, 0, 0.1)).all() and np.ptp(moved - even, axis=0)[0] > 0.3
    assert np.array_equal(moved[:, 1], even[:, 1])


def test_a_ring_stands_around_its_axis_and_faces_outwards() -> None:
    middles, axes = placed("count: 8, layout: {ring: {radius: 2, axis: [0, 0, 3], centre: [1, 0, 0]}}")
    out = middles - (1, 0, 0)
    assert np.allclose(np.linalg.norm(out, axis=1), 2) and np.allclose(out[:, 2], 0)
    assert np.allclose(axes[:, :, 0], out / 2) and np.allclose(axes[:, :, 1], (0, 0, 1))
    steps = np.linalg.norm(middles - np.roll(middles, 1, axis=0), axis=1)
    assert np.allclose(steps, steps[0])


def test_copies_lean_outwards() -> None:
    middles, axes = placed("count: 5, layout: {ring: {radius: 1}, lean: 30}")
    outwards = (axes[:, :, 1] * middles).sum(axis=1)
    assert np.allclose(outwards, 0.5) and np.allclose(axes[:, 1, 1], np.cos(np.pi / 6))


def test_a_spiral_has_equal_steps_and_a_disc_fills_its_circle() -> None:
    middles, _ = placed("count: 60, layout: {spiral: {radius: [0.5, 2], turns: 3, height: 1}}")
    steps = np.linalg.norm(np.diff(middles, axis=0), axis=1)
    assert np.ptp(steps[5:]) < 0.01 and np.isclose(np.ptp(middles[:, 1]), 1)
    assert np.allclose(np.hypot(middles[[0, -1], 0], middles[[0, -1], 2]), (0.5, 2))
    middles, _ = placed("count: 400, layout: {disc: {radius: 2}}")
    assert np.isclose((np.hypot(middles[:, 0], middles[:, 2]) < 1).mean(), 0.25, atol=0.01)


@pytest.mark.parametrize(
    "surface", shot_rows(["solid: icosphere, radius: 1.5", "model: ball.obj, scale: 1.5"])
)
def test_copies_on_a_surface_stand_upright_on_it(surface: str, tmp_path: Path) -> None:
    ball = icosphere(3)
    lines = [f"v {x} {y} {z}\n" for x, y, z in ball.vertices]
    lines += [f"f {a} {b} {c}\n" for a, b, c in ball.faces + 1]
    (tmp_path / "ball.obj").write_text("".join(lines))
    motion = motion_of(f"count: 300, layout: {{surface: {{{surface}, offset: 0.5}}}}", tmp_path / "a.yaml")
    placements = motion.of_shape()[1]
    away = np.linalg.norm(placements.origins, axis=1)
    assert away.min() > 1.85 and away.max() < 2.01
    assert ((placements.matrices[:, :, 1] * placements.origins).sum(axis=1) / away > 0.97).all()
    apart = np.linalg.norm(placements.origins[:, None] - placements.origins, axis=2) + 9 * np.eye(300)
    assert np.median(apart.min(axis=1)) > 0.5 * (16 * np.pi / 300) ** 0.5


def test_refining_keeps_area_and_reaches_the_number_of_faces() -> None:
    fine = refined(TriangleMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), 60)
    corners = fine.vertices[fine.faces]
    sides = corners[:, 1:] - corners[:, :1]
    assert len(fine.faces) == 64 and np.allclose(np.cross(sides[:, 0], sides[:, 1])[:, 2], 1 / 64)


@settings(deadline=None, max_examples=8)
@given(st.integers(0, 2**31), st.sampled_from(["upright", "random"]))
def test_size_and_turn_differ_by_the_seed_alone(seed: int, turn: str) -> None:
    text = f"count: 30, seed: {seed}, size: [0.5, 2], turn: {turn}, layout: {{ring: {{radius: 3}}}}"
    (middles, axes), (again, same) = placed(text), placed(text)
    assert np.array_equal(middles, again) and np.array_equal(axes, same)
    sizes = np.linalg.norm(axes, axis=1)
    assert (sizes > 0.499).all() and (sizes < 2.001).all() and np.ptp(sizes) > 0.5
    assert np.allclose(sizes, sizes[:, :1])
    assert (np.abs(axes[:, 1, 1] / sizes[:, 1] - 1.0) < 1e-12).all() == (turn == "upright")
    assert len(np.unique(axes[:, 0, 0])) == 30


def test_scattered_copies_of_all_sizes_keep_apart() -> None:
    middles, axes = placed("count: 60, size: [0.3, 1.5], region: {sphere: {radius: 1}}")
    radii = 0.5 * np.linalg.norm((0.1, 0.02, 0.2)) * np.linalg.norm(axes[:, :, 0], axis=1)
    apart = np.linalg.norm(middles[:, None] - middles, axis=2) + 9 * np.eye(60)
    assert (apart > radii[:, None] + radii).all()
    assert (np.linalg.norm(middles, axis=1) + radii <= 1.0 + 1e-9).all()


@pytest.mark.parametrize(
    ("copies", "fault"),
    [
        ("count: 9, layout: {grid: {cells: [2, 2, 2], spacing: [1, 1, 1]}}", "8 cells, and count is 9"),
        ("count: 9", "the place of copies is one of region, layout, and this has none"),
        ("count: 9, layout: {}", "a layout is one of grid, ring, disc, spiral, surface"),
        ("count: 9, size: [2, 1], layout: {ring: {radius: 1}}", "size goes from 2 to 1"),
        ("count: 9, layout: {ring: {radius: 1, axis: [0, 0, 0]}}", "axis has no length"),
        ("count: 9, layout: {surface: {radius: 1}}", "on a solid or on a model"),
        ("count: 9, layout: {surface: {solid: torus, length: 1}}", "length is not a measure of the torus"),
        ("count: 9, layout: {surface: {solid: bol}}", "'bol' is not a solid"),
        ("count: 5001, layout: {ring: {radius: 1}}", "5000"),
    ],
)
def test_one_message_a_mistake(copies: str, fault: str) -> None:
    with pytest.raises(ShotError) as caught:
        motion_of(copies)
    assert fault in str(caught.value) and len(caught.value.messages) == 1


def test_a_missing_model_of_a_layout_is_a_missing_input() -> None:
    with pytest.raises(ShotError, match=r"no\.obj"):
        motion_of("count: 9, layout: {surface: {model: no.obj}}")


def test_copies_that_deform_may_not_touch_in_a_layout() -> None:
    text = SHOT.replace("COPIES", "count: 40, layout: {ring: {radius: 1}}")
    with pytest.raises(ShotError, match="touch; those of a shape that deforms lie apart"):
        read_shot("a.yaml", text.replace(", rigid: true", ""))
    assert read_shot("a.yaml", text)


def coloured(pigment: str) -> tuple[Motion, np.ndarray]:
    """Return a motion of 40 copies, and the colours (40, V, 3) of their vertices at rest."""
    look = f"look: {{material: clay, pigment: {pigment}}}"
    text = SHOT.replace("COPIES", "count: 40, layout: {ring: {radius: 2}}")
    text = text.replace("solid: box,", f"solid: box, {look},")
    part = read_shot("a.yaml", text).subjects[0]
    frame = next(animate(part.motion))
    rest, look = frame.mesh.attributes["material"], part.picture.look
    places = part.motion.copy_places(look.pattern, rest)
    surface = Surface(rest.astype("f4"), rest.astype("f4"), frame.mesh.faces, places, rest.astype("f4"))
    colours = look.vertex_colours(surface)
    assert colours is not None
    return part.motion, colours.reshape(40, -1, 3)


def test_a_palette_gives_each_copy_one_colour_by_chance() -> None:
    written = ["[0.8, 0.1, 0.1]", "[0.1, 0.8, 0.1]", "[0.1, 0.1, 0.8]"]
    pigment = f"{{palette: {{colours: [{', '.join(written)}], seed: SEED}}}}"
    (_, colours), (_, others) = (coloured(pigment.replace("SEED", seed)) for seed in "34")
    assert (colours == colours[:, :1]).all()
    kinds, counts = np.unique(colours[:, 0].round(4), axis=0, return_counts=True)
    assert len(kinds) == 3 and set(np.sort(kinds, axis=None).tolist()) == {0.1, 0.8} and counts.min() > 5
    assert not np.array_equal(colours[:, 0], others[:, 0])


def test_a_pattern_by_copy_shows_the_colour_at_the_middle() -> None:
    gradient = "gradient: {colours: [[0, 0, 0], [1, 1, 1]], axis: x, scale: 4"
    (motion, each), (_, smooth) = coloured(f"{{{gradient}, per_copy: true}}}}"), coloured(f"{{{gradient}}}}}")
    assert (each == each[:, :1]).all() and np.ptp(smooth[3, :, 0]) > 0.02
    assert np.allclose(each[:, 0, 0], 0.5 + motion.of_shape()[1].origins[:, 0] / 4, atol=2e-3)


def test_a_colour_for_each_copy_needs_places_of_copies() -> None:
    points, palette = np.zeros((3, 3), np.float32), Pigment("palette", ((0, 0, 0), (1, 1, 1)))
    with pytest.raises(BadInputError, match="no places of copies"):
        palette.places(Surface(points, points, np.zeros((0, 3), np.int32), {}, points))
