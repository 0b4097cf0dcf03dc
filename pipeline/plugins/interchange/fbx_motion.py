"""Animations in FBX files: nodes, skins and blend shapes at any time, which ufbx evaluates in a process.

ufbx 0.0.5 crashes where a scene is freed, so that each sample takes memory until the process ends.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flowsculpt import MeshError
from flowsculpt.api import quote
from flowsculpt.api.files import InputFile, Parser
from flowsculpt.api.meshes import FileSurface, Floats, MovingSurface, ScenePart
from flowsculpt.pipeline.plugins.interchange.fbx_files import (
    FBX,
    MOST_BYTES,
    counted,
    loaded_scene,
    numbers_of,
    polygons_of,
    require_ufbx,
    shown_meshes,
    turn_of,
    uncollected,
)
from flowsculpt.pipeline.plugins.interchange.moving_files import (
    MotionFacts,
    MovingFile,
    answer_about,
    chosen_animation,
    require_times,
    several_animations,
)
from flowsculpt.pipeline.plugins.interchange.scene_readers import PlacedMeshes, Polygons, joined, known_unit

if TYPE_CHECKING:
    import ufbx

_MODULE = "flowsculpt.pipeline.plugins.interchange.fbx_motion"

_SAMPLES = 50  # of a process, which keeps them all

_VISIBILITY = ("Visibility", "Show")


class FbxSource:
    """An open FBX file: see `MotionSource`. Raises MeshError where it has no animation of the name."""

    @uncollected()
    def __init__(self, content: bytes, animation: str) -> None:
        self._scene = loaded_scene(content, ignore_animation=False)
        self._kept: list[Any] = []
        self._read: dict[int, Polygons] = {}
        stacks: dict[str, tuple[Any, list[Any]]] = {}
        for stack in self._counted(self._scene.anim_stacks):
            layers = self._counted(stack.layers)
            if any(len(layer.anim_props) for layer in layers):
                stacks[stack.name] = stack, layers
        chosen = chosen_animation(animation, stacks)
        if len(stacks) > 1 and not animation:
            raise several_animations(stacks)
        self._stack, self._layers = stacks.get(chosen, (None, []))

    def _counted(self, elements: Any) -> list[Any]:
        """Return the elements of a list of ufbx, and keep them."""
        found = [counted(element) for element in elements]
        self._kept += found
        return found

    @property
    def motion(self) -> MotionFacts:
        times, is_fixed = np.empty(0), True
        if self._stack is not None:
            times = np.array([self._stack.time_begin, self._stack.time_end])
            properties = [prop for layer in self._layers for prop in self._counted(layer.anim_props)]
            is_fixed = not any(prop.prop_name in _VISIBILITY for prop in properties)
            if times[1] <= times[0]:
                values = self._counted(prop.anim_value for prop in properties)
                curves = self._counted(
                    curve for value in values for curve in value.curves if curve is not None
                )
                times = np.array([min(c.min_time for c in curves), max(c.max_time for c in curves)])
        require_times(np.unique(times), "Export it with its animation, or write model in place of sequence.")
        rate = float(self._scene.settings.frames_per_second)
        return MotionFacts(np.unique(times), rate if 0.0 < rate < np.inf else None, is_fixed, True)

    @uncollected()
    def surface(self, seconds: float) -> FileSurface:
        import ufbx

        scene = ufbx.evaluate_scene(self._scene, counted(self._stack.anim), seconds, evaluate_skinning=True)
        self._kept.append(scene)
        turn, meshes = turn_of(scene), PlacedMeshes()
        for node, mesh, matrix in shown_meshes(scene, Counter()):
            name = quote(node.name or mesh.name)
            if mesh.element_id not in self._read:
                self._read[mesh.element_id] = polygons_of(mesh, name)
            polygons = self._read[mesh.element_id]
            if len(mesh.cache_deformers):
                raise MeshError(
                    f"{name} is moved by a geometry cache, which is not read. Export it as Alembic"
                )
            if len(mesh.skin_deformers) or len(mesh.blend_deformers):
                polygons = polygons._replace(points=_moved_points(mesh, polygons, name))
                matrix = matrix if mesh.skinned_is_local else turn
            meshes.add(polygons, matrix)
        if not meshes.parts:
            raise MeshError("it has no visible mesh then")
        return joined(meshes.parts)._replace(unit=known_unit(scene.settings.unit_meters))


def _moved_points(mesh: ufbx.Mesh, polygons: Polygons, name: str) -> Floats:
    """Return the points (V, 3) where skins and blend shapes take them."""
    points = numbers_of(mesh.skinned_position.values, np.float64, 3)
    if points.shape != polygons.points.shape:
        raise MeshError(f"{name} has {len(polygons.points)} vertices, and {len(points)} with its skin")
    return points.copy()


def open_fbx(path: Path, part: ScenePart | None) -> MovingSurface:
    """Open the animation of a file: see `FileFormat.motion`. Raises MachineError without ufbx."""
    require_ufbx()
    assert FBX.files is not None
    InputFile(path, MOST_BYTES).size()
    name = part.animation or "" if part else ""
    return MovingFile.opened(path, _MODULE, FBX.files(path), "ufbx", name, samples=_SAMPLES)


def begin(path: str, animation: str) -> Callable[[str], bytes]:
    """Return what answers about a file."""
    size = InputFile(Path(path), MOST_BYTES).size()
    Parser.allow_memory(Parser.MEMORY + 40 * size)
    return answer_about(lambda: FbxSource(InputFile(Path(path), MOST_BYTES).content(), animation))


if __name__ == "__main__":
    Parser.serve_session(begin)
