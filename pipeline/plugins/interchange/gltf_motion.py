"""Animations in glTF files: nodes, skins and morph targets at any time (glTF 2.0, §3.11 and appendix C)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flowsculpt import MeshError
from flowsculpt.api import shorten
from flowsculpt.api.files import InputFile, Parser
from flowsculpt.api.meshes import FileSurface, Floats, MovingSurface, ScenePart, SourceFiles
from flowsculpt.pipeline.plugins.interchange.gltf_document import MOST_BYTES, GltfDocument, JsonObject
from flowsculpt.pipeline.plugins.interchange.gltf_files import SceneArrays, files_of_buffers, require_draco
from flowsculpt.pipeline.plugins.interchange.gltf_scene import DefaultScene, PlacedPrimitive
from flowsculpt.pipeline.plugins.interchange.moving_files import (
    MotionFacts,
    MovingFile,
    answer_about,
    chosen_animation,
    require_times,
    several_animations,
)

_MODULE = "flowsculpt.pipeline.plugins.interchange.gltf_motion"

_POINTER = "KHR_animation_pointer"

_PATHS = {"translation": "VEC3", "rotation": "VEC4", "scale": "VEC3", "weights": "SCALAR"}


class _Channel(NamedTuple):
    """What moves a value of a node; `place` is for messages."""

    node: int
    path: str
    sampler: JsonObject
    place: str


@dataclass
class AnimatedScene(DefaultScene):
    """A scene with the channels that move it.

    animation  name of the animation; empty for all, which then move different values
    """

    animation: str = ""

    @cached_property
    def channels(self) -> list[_Channel]:
        """The channels that move nodes of the scene. Raises MeshError for an animation that is not there."""
        found = {}
        for number, animation in enumerate(self.document.root.entries("animations")):
            own = [channel for channel in self._channels_of(animation) if channel.node in self._parents]
            name = animation.text("name") or f"animation {number}"
            while own and name in found:
                name += "'"
            if own:
                found[name] = own
        if self.animation:
            return found[chosen_animation(self.animation, found)]
        channels = [channel for own in found.values() for channel in own]
        if len({(channel.node, channel.path) for channel in channels}) < len(channels) and len(found) > 1:
            raise several_animations(found)
        return channels

    def _channels_of(self, animation: JsonObject) -> Iterator[_Channel]:
        samplers = animation.items("samplers")
        for k, channel in enumerate(animation.entries("channels")):
            place = f"channel {k} of {animation.place}"
            target, number = channel.entry("target"), channel.whole("sampler")
            if number >= len(samplers):
                raise ValueError(f"{place} names sampler {number}; there are {len(samplers)}, from 0")
            sampler = JsonObject(samplers[number], f"sampler {number} of {animation.place}")
            pointer = target.extension(_POINTER)
            if pointer is not None:
                yield from self._pointed(pointer.text("pointer"), sampler, place)
            elif "node" in target and target.text("path") in _PATHS:
                self.document.item("nodes", target.values["node"], place)
                yield _Channel(target.whole("node"), target.text("path"), sampler, place)

    def _pointed(self, pointer: str, sampler: JsonObject, place: str) -> Iterator[_Channel]:
        """Yield the channel of a pointer to a value; what is not about surfaces is left out."""
        kind, _, rest = pointer.removeprefix("/").partition("/")
        number, _, path = rest.partition("/")
        if kind == "nodes" and number.isdigit() and path in _PATHS:
            yield _Channel(int(number), path, sampler, place)
        elif kind in ("nodes", "meshes", "skins") and "light" not in path and "camera" not in path:
            raise MeshError(f"{place} moves {shorten(pointer)}, which is not read. Export it without.")

    @cached_property
    def views(self) -> frozenset[int]:
        found = set(super().views)
        for channel in self.channels:
            for name in ("input", "output"):
                found |= self.views_of(channel.sampler.whole(name), channel.place)
        for part in self.distinct:
            for target in part.primitive.entries("targets"):
                if "POSITION" in target:
                    found |= self.views_of(target.values["POSITION"], part.place)
        return frozenset(found)


class MovedArrays(SceneArrays):
    """Reads the arrays of a scene, with its morph targets applied."""

    scene: AnimatedScene

    def _morphed(self, part: PlacedPrimitive, points: Floats) -> Floats:
        targets = list(part.primitive.entries("targets"))
        weights = self.scene.posed(part.number).numbers("weights") or part.mesh.numbers("weights")
        if weights and len(weights) != len(targets):
            raise ValueError(f"{part.place} has {len(targets)} morph targets and {len(weights)} weights")
        for target, weight in zip(targets, weights, strict=False):
            if weight and "POSITION" in target:
                moves = self._numbers(target.values["POSITION"], part.place, "VEC3")
                if moves.shape != points.shape:
                    raise ValueError(
                        f"{part.place} has {len(points)} vertices, and a morph target {len(moves)}"
                    )
                points = points + weight * moves
        return points

    def track(self, channel: _Channel) -> Track:
        """Return the keys of a channel. Raises ValueError for damaged ones."""
        times = self._numbers(channel.sampler.whole("input"), channel.place, "SCALAR").reshape(-1)
        values = self._numbers(channel.sampler.whole("output"), channel.place, _PATHS[channel.path])
        how = channel.sampler.text("interpolation", "LINEAR")
        if how not in ("STEP", "LINEAR", "CUBICSPLINE"):
            raise ValueError(f"interpolation of {channel.sampler.place} is {shorten(how)}, not one of glTF's")
        if not len(times) or not np.isfinite(times).all() or (np.diff(times) < 0.0).any():
            raise ValueError(f"the times of {channel.place} do not ascend")
        rows = len(times) * (3 if how == "CUBICSPLINE" else 1)
        if len(values) == 0 or len(values) % rows or (channel.path != "weights" and len(values) != rows):
            raise ValueError(f"{channel.place} has {len(values)} values for {len(times)} keys")
        if not np.isfinite(values).all():
            raise ValueError(f"a value of {channel.place} is not finite")
        shape = (len(times), 3, -1) if how == "CUBICSPLINE" else (len(times), -1)
        return Track(times, values.reshape(shape), how, channel.path == "rotation")


class Track(NamedTuple):
    """Keys at times (K,), of values (K, n), or (K, 3, n) with in-tangents and out-tangents around them."""

    times: Floats
    values: Floats
    how: str
    is_rotation: bool

    def at(self, seconds: float) -> list[float]:
        """Return the value at a time (glTF 2.0, appendix C)."""
        key = int(np.searchsorted(self.times, seconds, "right")) - 1
        is_cubic = self.how == "CUBICSPLINE"
        values = self.values[:, 1] if is_cubic else self.values
        if key < 0 or key + 1 >= len(self.times) or self.how == "STEP":
            return list(values[max(key, 0)].tolist())
        step = self.times[key + 1] - self.times[key]
        share = (seconds - self.times[key]) / step
        before, after = values[key], values[key + 1]
        if is_cubic:
            value = _hermite(share, before, step * self.values[key, 2], after, step * self.values[key + 1, 0])
        elif self.is_rotation:
            value = _turned(share, before, after)
        else:
            value = before + share * (after - before)
        return list(value.tolist())


def _hermite(t: float, before: Floats, out: Floats, after: Floats, into: Floats) -> Floats:
    """Return the value of the cubic with these ends and tangents."""
    t2, t3 = t * t, t * t * t
    return (
        (2.0 * t3 - 3.0 * t2 + 1.0) * before
        + (t3 - 2.0 * t2 + t) * out
        + (3.0 * t2 - 2.0 * t3) * after
        + (t3 - t2) * into
    )


def _turned(t: float, before: Floats, after: Floats) -> Floats:
    """Return the quaternion on the shorter arc between two."""
    a, b = (q / max(float(np.linalg.norm(q)), 1e-300) for q in (before, after))
    cosine = float(a @ b)
    b = b if cosine >= 0.0 else -b
    angle = np.arccos(min(abs(cosine), 1.0))
    if angle < 1e-6:
        return a + t * (b - a)
    return (np.sin((1.0 - t) * angle) * a + np.sin(t * angle) * b) / np.sin(angle)


@dataclass
class GltfSource:
    """An open glTF file: see `MotionSource`."""

    scene: AnimatedScene
    _tracks: dict[tuple[int, str], Track] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._arrays = MovedArrays(self.scene)
        for channel in self.scene.channels:
            self._tracks[channel.node, channel.path] = self._arrays.track(channel)
            if channel.path != "weights" and "matrix" in self.scene.document.item(
                "nodes", channel.node, channel.place
            ):
                raise ValueError(f"{channel.place} moves node {channel.node}, which has a matrix")

    @property
    def motion(self) -> MotionFacts:
        ends = [time for track in self._tracks.values() for time in (track.times[0], track.times[-1])]
        times = np.unique([min(ends), max(ends)]) if ends else np.empty(0)
        require_times(times, "Export it with its animation, or write model in place of sequence.")
        return MotionFacts(times, None, True, True)

    def surface(self, seconds: float) -> FileSurface:
        pose: dict[int, dict[str, Any]] = {}
        for (node, path), track in self._tracks.items():
            pose.setdefault(node, {})[path] = track.at(seconds)
        self.scene.pose(pose)
        points, faces = self._arrays.surface()
        return FileSurface.of(points, faces, base=None)


def _scene(path: Path, animation: str) -> AnimatedScene:
    scene = AnimatedScene.of(GltfDocument.read(path))
    assert isinstance(scene, AnimatedScene)
    scene.animation = animation
    return scene


def open_gltf(path: Path, part: ScenePart | None) -> MovingSurface:
    """Open the animation of a file: see `FileFormat.motion`."""
    name = part.animation or "" if part else ""
    scene = _scene(path, name)
    require_draco(scene)
    files = [(file, InputFile(file).digest()) for file in (path, *files_of_buffers(scene))]
    return MovingFile.opened(path, _MODULE, SourceFiles.of(files), "numpy", name)


def begin(path: str, animation: str) -> Callable[[str], bytes]:
    """Return what answers about a file."""
    scene = _scene(Path(path), animation)
    files = (Path(path), *files_of_buffers(scene))
    Parser.allow_memory(Parser.MEMORY + 40 * sum(InputFile(file, MOST_BYTES).size() for file in files))
    return answer_about(lambda: GltfSource(scene))


if __name__ == "__main__":
    Parser.serve_session(begin)
