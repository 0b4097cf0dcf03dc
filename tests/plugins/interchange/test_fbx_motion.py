"""Animations of FBX files: nodes, skins and blend shapes where the file has them at a time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.errors import MeshError
from flowsculpt.pipeline.mesh.mesh_formats import ScenePart
from flowsculpt.pipeline.mesh.read import ModelFile
from tests.plugins.interchange.fbx_writer import CORNERS, N, box_geometry, model, properties, scene, text

SECOND = 46186158000  # of the clock of FBX
LINEAR = 0x4


def keys(number: int, *values: float) -> N:
    """Return a curve with a key each second."""
    return N(
        "AnimationCurve",
        (number, "AnimCurve::", ""),
        [
            N("KeyVer", (4009,)),
            N("KeyTime", ([k * SECOND for k in range(len(values))],)),
            N("KeyValueFloat", (list(values),)),
            N("KeyAttrFlags", ([LINEAR],)),
            N("KeyAttrDataFloat", ([0.0, 0.0, 0.0, 0.0],)),
            N("KeyAttrRefCount", ([len(values)],)),
        ],
    )


def animation(
    first: int, name: str, target: int, *links: tuple[str, N], prop: str
) -> tuple[list[N], list[tuple]]:
    """Return a stack with a layer that moves a property of an element by curves, and its connections."""
    stack = N("AnimationStack", (first, f"AnimStack::{name}", ""), [properties()])
    layer = N("AnimationLayer", (first + 1, "AnimLayer::Base", ""), [])
    node = N("AnimationCurveNode", (first + 2, f"AnimCurveNode::{prop}", ""), [properties()])
    curves = [(curve.values[0], first + 2, axis) for axis, curve in links]
    joined = [(first + 1, first), (first + 2, first + 1), (first + 2, target, prop), *curves]
    return [stack, layer, node, *(curve for _, curve in links)], joined


def moving_box(path: Path, *names: str) -> Path:
    """Write a box that a skin carries: its joint goes from 0 to 4 along y within a second, and by a shape."""
    objects = [box_geometry(1), model(2, "box"), model(3, "joint", "LimbNode")]
    links: list[tuple] = [(1, 2), (2, 0), (3, 0)]
    upper = [k for k, corner in enumerate(CORNERS) if corner[0] > 0]
    identity = [float(value) for value in np.eye(4).reshape(-1)]
    cluster = [N("Indexes", (upper,)), N("Weights", ([1.0] * len(upper),))]
    cluster += [N("Transform", (identity,)), N("TransformLink", (identity,))]
    objects.append(N("Deformer", (4, "Deformer::", "Skin"), []))
    objects.append(N("Deformer", (5, "SubDeformer::", "Cluster"), cluster))
    links += [(4, 1), (5, 4), (3, 5)]
    for k, name in enumerate(names):
        rise = ("d|Y", keys(19 + 20 * k, 0.0, 4.0))
        more, joined = animation(10 + 20 * k, name, 3, rise, prop="Lcl Translation")
        objects += more
        links += joined
    path.write_bytes(text(scene(objects, links, UpAxis=1, UnitScaleFactor=100.0)))
    return path


def test_a_skin_carries_its_vertices_at_any_time(tmp_path: Path) -> None:
    moving = ModelFile(moving_box(tmp_path / "a.fbx", "Take")).motion()
    assert moving.times.tolist() == [0.0, 1.0] and moving.is_fixed and moving.is_continuous
    expected = np.array(CORNERS)
    for seconds in (0.0, 0.25, 1.0):
        surface = moving.at(seconds)
        assert surface.points == pytest.approx(expected + np.outer(expected[:, 0] > 0, [0, 4 * seconds, 0]))
    assert surface.unit == 1.0
    moving.close()


def test_one_of_several_animations_is_chosen_by_its_name(tmp_path: Path) -> None:
    path = moving_box(tmp_path / "a.fbx", "Walk", "Run")
    with pytest.raises(
        MeshError, match=r"a\.fbx: it has several animations: Walk, Run. Write animation: Walk"
    ):
        ModelFile(path).motion()
    assert len(ModelFile(path, ScenePart(animation="Run")).motion().times) == 2
    with pytest.raises(MeshError, match=r"a\.fbx: nothing moves in it. Export it with its animation"):
        ModelFile(moving_box(tmp_path / "a.fbx")).motion()
