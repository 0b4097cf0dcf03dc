"""Resampled sequences whose parts cut through each other or touch each other in the first frame, and part."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.animation import MeshFrame, animate
from flowsculpt.pipeline.mesh import TriangleMesh, box
from flowsculpt.pipeline.shot import Shot, read_shot
from tests.mesh_files import write_ply

FRAMES = 6
EDGE = 0.11


def read(folder: Path, mesh: Callable[[int], TriangleMesh], copies: str = "") -> Shot:
    for number in range(1, FRAMES + 1):
        write_ply(mesh(number), folder / f"part_{number:04d}.ply")
    (folder / "a.yaml").write_text(
        f"title: T\nframes: 1-{FRAMES}\nsubjects:\n  a:\n    sequence: part_####.ply\n"
        f"    resample: {{max_edge_length: {EDGE}}}\n{copies}"
    )
    return read_shot(folder / "a.yaml")


def bars(number: int) -> TriangleMesh:
    """Two flat bars that cross with their sides in the same planes; the second one rises and turns away."""
    one, two = box((2.0, 0.2, 0.3), 0.3), box((0.3, 0.2, 2.0), 0.28)
    angle, rise = 0.05 * (number - 1), 0.12 * (number - 1)
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    moved = (two.vertices + np.array([0.02, 0.0, 0.03])) @ turn.T + [0.0, rise, 0.0]
    faces = np.concatenate([one.faces, two.faces + len(one.vertices)])
    return TriangleMesh(np.concatenate([one.vertices, moved]), faces)


def folded(number: int) -> TriangleMesh:
    """A sheet of two layers that lie on each other and open about the line x = 1."""
    lower, upper = np.linspace(0.0, 1.0, 6), np.linspace(0.0, 0.87, 6)[1:]
    along = np.concatenate([lower, 1.0 + upper])
    x, z = (each.ravel() for each in np.meshgrid(along, np.linspace(0.0, 1.0, 5), indexing="ij"))
    angle, is_upper = np.pi - 0.25 * (number - 1), x > 1.0
    points = np.column_stack([x, 0.0 * x, z])
    away = x[is_upper] - 1.0
    points[is_upper, 0], points[is_upper, 1] = 1.0 + away * np.cos(angle), away * np.sin(angle)
    i, j = (each.ravel() for each in np.meshgrid(np.arange(len(along) - 1), np.arange(4), indexing="ij"))
    a, b, c, d = i * 5 + j, i * 5 + j + 1, (i + 1) * 5 + j, (i + 1) * 5 + j + 1
    return TriangleMesh(points, np.concatenate([np.stack([a, b, c], 1), np.stack([b, d, c], 1)]))


def longest_edge(mesh: TriangleMesh) -> float:
    corners = mesh.vertices[mesh.faces]
    return float(np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).max())


def area(mesh: TriangleMesh) -> float:
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def check(frames: list[MeshFrame], mesh: Callable[[int], TriangleMesh], copies: int = 1) -> None:
    """Compare the area, which one vertex on a wrong part would change, and edges and faces."""
    for frame in frames:
        assert area(frame.mesh) == pytest.approx(copies * area(mesh(frame.number)), rel=1e-3)
        assert longest_edge(frame.mesh) <= EDGE + 1e-9
        assert len(frame.mesh.faces) < 1.2 * len(frames[0].mesh.faces)


@pytest.mark.parametrize("mesh", [bars, folded])
def test_parts_that_meet_in_the_first_frame_part_as_in_the_files(
    tmp_path: Path, mesh: Callable[[int], TriangleMesh]
) -> None:
    frames = list(animate(read(tmp_path, mesh).parts[0]))
    assert len(frames[0].mesh.faces) > 4 * len(mesh(1).faces)
    check(frames, mesh)


def test_copies_of_parts_that_meet_part_alike(tmp_path: Path) -> None:
    copies = "    copies: {count: 2, seed: 2, region: {sphere: {radius: 3}}}\n"
    check(list(animate(read(tmp_path, bars, copies).parts[0])), bars, copies=2)


def test_an_interrupted_run_goes_on_with_the_same_bits(tmp_path: Path) -> None:
    shot = read(tmp_path, bars).parts[0]
    frames = list(animate(shot))
    kept = MeshFrame.from_arrays(frames[2].to_arrays(), frames[2].number)
    *_, last = animate(shot, resume=kept)
    for name, values in frames[-1].mesh.attributes.items():
        np.testing.assert_array_equal(last.mesh.attributes[name], values)
    np.testing.assert_array_equal(last.mesh.faces, frames[-1].mesh.faces)
