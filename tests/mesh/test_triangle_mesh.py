"""A mesh is a value: what it is made from may change afterwards, and what it holds may not."""

from __future__ import annotations

import numpy as np
import pytest

from flowsculpt.pipeline.mesh import HalfedgeMesh, TriangleMesh, icosphere
from flowsculpt.pipeline.mesh.meshes import freeze


def test_arrays_of_a_mesh_are_taken_into_others_without_a_copy() -> None:
    ball = icosphere(2).with_attributes(heat=np.arange(len(icosphere(2).vertices)))
    moved = ball.with_vertices(2.0 * ball.vertices).with_creases(ball.faces[:2, :2])
    assert moved.faces is ball.faces
    assert moved.attributes["heat"] is ball.attributes["heat"]
    assert moved.with_attributes(more=ball.vertices).attributes["more"] is ball.vertices


@pytest.mark.parametrize("kind", ["writable", "a read-only view", "another order", "another type"])
def test_what_may_change_or_is_of_another_kind_is_copied(kind: str) -> None:
    ball = icosphere(2)
    kept = ball.vertices.copy(order="F" if kind == "another order" else "C")
    if kind == "another type":
        kept = kept.astype(np.float32).astype(">f8")
    given = kept[:] if kind == "a read-only view" else kept
    given.flags.writeable = kind == "writable"
    mesh, expected = TriangleMesh(given, ball.faces), kept.copy()
    if kept.flags.writeable:
        kept[:] = 9.0
    assert not np.shares_memory(mesh.vertices, kept)
    assert np.array_equal(mesh.vertices, expected)
    assert mesh.vertices.flags.c_contiguous and not mesh.vertices.flags.writeable
    assert mesh.vertices.dtype == np.float64 and mesh.vertices.dtype.isnative


def test_a_frozen_array_in_another_shape_is_taken_without_a_copy_and_a_part_of_one_is_copied() -> None:
    ball = icosphere(2)
    flat = ball.vertices.ravel().copy()
    given = flat.reshape(-1, 3)
    freeze(given)
    assert not flat.flags.writeable and TriangleMesh(given, ball.faces).vertices is given
    part = TriangleMesh(np.vstack([given, given]), ball.faces).vertices[: len(given)]
    assert not np.shares_memory(TriangleMesh(part, ball.faces).vertices, part)


def test_a_snapshot_stays_what_it_was() -> None:
    ball = icosphere(2)
    live = HalfedgeMesh(ball.with_attributes(rest=ball.vertices, heat=np.zeros(len(ball.vertices))))
    before = live.snapshot()
    live.vertices[:] = 7.0
    live.arrays.attributes[:] = 7.0
    assert np.array_equal(before.vertices, ball.vertices)
    assert np.array_equal(before.attributes["rest"], ball.vertices)
    assert not before.attributes["heat"].any()
