"""Mesh frames for other programs, with normals, velocities and colours, and folders of files of them."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from flowsculpt import FrameError
from flowsculpt.api.files import CachedAnswer, sweep_hidden_drafts, to_plain
from flowsculpt.api.frames import (
    Locks,
    MeshFrame,
    PipelineStage,
    RenderRequest,
    Shading,
    Store,
    StoredFiles,
    key_of,
)
from flowsculpt.api.materials import Material, PaintedFaces, Surface
from flowsculpt.api.meshes import Floats, Indices
from flowsculpt.api.shots import Model, Shot, Solid

EXPORT = PipelineStage("export", version=5, doing="exporting", makes="geometry", per_quality=False)


@dataclass(eq=False)
class KeyedFiles:
    """The exported files of one folder. A file is current while it has the digest that is noted with its key.

    A file that was replaced or damaged after its key was noted has another digest, whoever did it.

    name  of the JSON file, which holds key and digest by file name
    """

    folder: Path
    name: str
    store: Store
    written: list[str] = field(default_factory=list)
    _found: dict[str, str | None] = field(default_factory=dict)
    """Digests of the files as they are, by name; None of those that cannot be read."""

    @cached_property
    def _noted(self) -> dict[str, dict[str, Any]]:
        """The content of the JSON file; empty if it is missing or damaged: all is then written again."""
        noted = CachedAnswer(self.folder / self.name).load(dict) or {}
        return {name: entry for name, entry in noted.items() if isinstance(entry, dict)}

    def is_whole(self, name: str) -> bool:
        """Tell whether a file is there as it was written."""
        noted = self._noted.get(name, {}).get("digest")
        if noted is not None and name not in self._found:
            self._found[name] = None
            with suppress(OSError):
                self._found[name] = StoredFiles.digest_of(self.folder / name)
        return noted is not None and self._found[name] == noted

    def is_current(self, name: str, key: str) -> bool:
        """Tell whether a file is there, whole, and made from what `key` says."""
        return self._noted.get(name, {}).get("key") == key and self.is_whole(name)

    def write(self, name: str, key: str, write: Callable[[Path], object]) -> None:
        """Write a file by `write(draft)`, whole or not at all. Raises MachineError where the disk refuses."""
        self._found[name] = digest = self.store.write(self.folder / name, write, flush=False)
        self._noted[name] = {"key": key, "digest": digest}
        self.written.append(name)

    def update(self, name: str, key: str, write: Callable[[Path], object]) -> None:
        """Write a file as `write` does, unless it is current."""
        if not self.is_current(name, key):
            self.write(name, key, write)

    @contextmanager
    def changing(self) -> Iterator[None]:
        """Keep other exports of these files waiting, and remove drafts of killed ones.

        The JSON file is written when the block ends, also by an error, if files were written in it. Raises
        MachineError where the disk refuses.
        """
        path, before = self.folder / self.name, len(self.written)
        with Locks(self.store.root).hold_key(key_of("export", str(path.absolute())), self._wait_and_tell()):
            self.__dict__.pop("_noted", None)  # another export may have written them meanwhile
            self._found.clear()
            sweep_hidden_drafts(self.folder)
            try:
                yield
            finally:
                if len(self.written) > before:
                    text = json.dumps(self._noted, indent=1, sort_keys=True) + "\n"
                    self.store.write(
                        path, lambda draft: draft.write_text(text, encoding="utf-8"), flush=False
                    )

    def _wait_and_tell(self) -> Callable[[], None]:
        """Return what is called while another export writes these files: it says so once."""
        messages = [f"Waiting for another export to {self.folder}"]

        def tell() -> None:
            while messages:
                logging.getLogger("flowsculpt.store").info(messages.pop())

        return tell


@dataclass(frozen=True, eq=False)
class ExportedFrame:
    """A frame of a sculpture, V points and F triangles. A point cloud has no triangles.

    points          (V, 3), scene units
    faces           (F, 3), counter-clockwise seen from outside; no vertex is split
    normals         (N, 3), unit
    corner_normals  (F, 3): the normal of each corner of a face; corners at a crease have different ones
    velocities      (V, 3), scene units per second
    rest            (V, 3): the positions in the undeformed subject
    creases         (K, 2): the edges that are tagged as creases, of two vertices each
    colours         linear Rec.709 reflectances (V, 3); None where the look has one colour
    texture         texture coordinates (F, 3, 2) of the corners of faces, or None
    paint           what a model's file has on the faces, where the look shows its materials, or None
    radii           (V,) of a point cloud's spheres, scene units; None of a surface
    numbers         (V,): what tells the points of a cloud apart; None of a surface
    copies          int32 (V,): the number of the copy, from 1 on, as in mattes; None without copies
    values          (V,): what the subject measures, NaN where it is missing; None where it measures nothing
    """

    points: Floats
    faces: Indices
    normals: Floats
    corner_normals: Indices
    velocities: Floats
    rest: Floats
    creases: Indices = field(default_factory=lambda: np.empty((0, 2), np.int32))
    colours: Floats | None = None
    texture: Floats | None = None
    paint: PaintedFaces | None = None
    radii: Floats | None = None
    numbers: np.ndarray | None = None
    copies: np.ndarray | None = None
    values: Floats | None = None

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """The least and the greatest coordinates (3,) of the points, and of the spheres around them."""
        around = 0.0 if self.radii is None else self.radii[:, None]
        return (self.points - around).min(axis=0), (self.points + around).max(axis=0)


def exported_frame(shot: Shot, frame: MeshFrame) -> ExportedFrame:
    """Return a mesh frame of a shot for other programs.

    A mesh is exported as it was simulated, without the curved patches that hide its facets. A control net is
    exported as its smooth surface. Raises FrameError where the flow fails, BadInputError where a picture of
    the look cannot be read.
    """
    if frame.is_cloud:
        return _exported_cloud(shot, frame)
    whole = frame if frame.copies is None else replace(frame, own=frame.mesh, copies=None, starts=None)
    shading = Shading.of(whole, shot.motion.thresholds_at(frame.number), shot.picture.tessellate)
    if shading.split is None:
        return _exported_net(shot, shading)
    return _exported_mesh(shot, frame, shading)


def _exported_mesh(shot: Shot, frame: MeshFrame, shading: Shading) -> ExportedFrame:
    mesh, rest, split = frame.mesh, frame.material, shading.split
    assert split is not None, "a mesh is split at its creases"
    velocities, source = Shading.vertex_motion(shot.motion, frame).velocity(), split.source_vertex
    look = shot.picture.look
    paint = shot.motion.painted(rest, mesh.faces)
    surface = rendered_surface(split.vertices, split.normals, split.faces, rest[source], velocities[source])
    named = shot.motion.copy_places(look.pattern, rest)
    if (values := mesh.attributes.get(Surface.VALUES)) is not None:
        named[Surface.VALUES] = values
    at_corners = {name: each[source].astype(np.float32) for name, each in named.items()}
    surface = replace(surface, attributes={**surface.attributes, **at_corners})
    colours = look.vertex_colours(replace(surface, paint=paint))
    return ExportedFrame(
        *(mesh.vertices, mesh.faces, split.normals, split.faces, velocities, rest, mesh.creases),
        colours=None if colours is None else colours[: len(rest)],  # the mesh's own vertices come first
        texture=texture_coordinates(look, rest, mesh.faces, paint),
        paint=paint if look.is_of_model else None,
        copies=_copies(shot, rest),
        values=_values(mesh.attributes.get(Surface.VALUES)),
    )


def _values(attribute: np.ndarray | None) -> Floats | None:
    """Return the values (V,) in the attribute VALUES (V, 2), NaN where they are missing; None without it."""
    if attribute is None:
        return None
    summed, known = attribute.T
    return np.where(known > 0.5, summed / np.where(known > 0.5, known, 1.0), np.nan)


def _exported_net(shot: Shot, shading: Shading) -> ExportedFrame:
    motion, arrays = shading.moved_by(shot.motion), shading.arrays()
    (points, normals), velocities = motion.at(0.0), motion.velocity()
    assert normals is not None, "a net has a surface"
    faces, rest = arrays["faces"], arrays["material"].astype(np.float64)
    surface = rendered_surface(points, normals, faces, rest, velocities)
    return ExportedFrame(
        *(points, faces, normals, faces, velocities, rest),
        colours=shot.picture.look.vertex_colours(surface),
        texture=texture_coordinates(shot.picture.look, rest, faces),
    )


def _exported_cloud(shot: Shot, frame: MeshFrame) -> ExportedFrame:
    points, rest = frame.mesh.vertices, frame.material
    velocities, nothing = Shading.vertex_motion(shot.motion, frame).velocity(), np.empty((0, 3))
    faces, numbers = nothing.astype(np.int32), frame.mesh.attributes.get("identity")
    surface = rendered_surface(points, np.zeros_like(points), faces, rest, velocities)
    places = shot.motion.copy_places(shot.picture.look.pattern, rest)
    surface = replace(surface, attributes={**surface.attributes, **places})
    return ExportedFrame(
        *(points, faces, nothing, faces, velocities, rest),
        colours=shot.picture.look.vertex_colours(surface),
        radii=frame.radii,
        numbers=np.arange(len(points)) if numbers is None else numbers,
        copies=_copies(shot, rest),
    )


def _copies(shot: Shot, rest: Floats) -> np.ndarray | None:
    """Return the number of the copy (V,) of vertices by their rest positions (V, 3); None without copies."""
    if shot.motion.copies is None:
        return None
    return (shot.motion.copy_indices(rest) + 1).astype(np.int32)


def rendered_surface(
    points: Floats, normals: Floats, faces: Indices, rest: Floats, velocities: Floats
) -> Surface:
    """Return the surface as it is rendered, float32, with the speed of its vertices."""
    vertices, shading, material = (values.astype(np.float32) for values in (points, normals, rest))
    speeds = np.linalg.norm(velocities, axis=1, keepdims=True).astype(np.float32)
    return Surface(vertices, shading, faces, {Surface.SPEED: speeds}, material)


def has_values(shot: Shot) -> bool:
    """Tell whether the subject of a shot measures something at its vertices."""
    animated = shot.motion.animated
    return animated is not None and "values" in animated.model.sequence.facts(0.0)


def has_colours(look: Material) -> bool:
    """Tell whether the colour of a look varies over the surface, so that vertices have colours."""
    return look.is_of_model or look.pattern is not None or look.texture("colour") is not None


def texture_coordinates(
    look: Material, rest: Floats, faces: Indices, paint: PaintedFaces | None = None
) -> Floats | None:
    """Return texture coordinates (F, 3, 2) of the corners of faces, 0 to 1 to the right and upwards.

    They repeat beyond. They are those of the textures of the look, otherwise those of the subject, if any.
    """
    projection = look.texture_projection
    if projection is None:
        return None if paint is None else paint.near_origin()
    coordinates, _ = projection.coordinates(rest, faces, paint)
    height = width = 1
    if projection.keeps_shape and (texture := look.texture("colour")) is not None:
        height, width = texture.pixels().shape[:2]
    right, up = projection.offset
    return np.asarray(coordinates * (1.0, width / height) + (0.5 - right, 0.5 - up))


def frame_key(request: RenderRequest, number: int) -> str:
    """Return the key of an exported frame: its mesh, the flow around it, and what colours its vertices."""
    motion = request.shot.motion
    return key_of(
        EXPORT.recipe,
        request.keys.normals(number),
        motion.velocity_data(number),
        str(motion.rate),
        *surface_recipe(request.shot),
        *request.keys.range_data(number),
        *([] if motion.copies is None else ["copies"]),
    )


def surface_recipe(shot: Shot) -> list[Any]:
    """Return what keys hold of colours and texture coordinates."""
    look = shot.picture.look
    plain = to_plain(look) if has_colours(look) or look.texture_projection else None
    has_own = has_coordinates(shot) and look.texture_projection is None
    return [plain, *(["texture coordinates"] if has_own else [])]


def has_coordinates(shot: Shot) -> bool:
    """Tell whether the surface of a shot is exported with texture coordinates."""
    subject = shot.motion.subject
    has_own = isinstance(subject, Solid) or (isinstance(subject, Model) and subject.paint)
    return has_own or shot.picture.look.texture_projection is not None


def stored_frame(request: RenderRequest, store: Store, number: int) -> ExportedFrame:
    """Return a frame of a shot for other programs, from the store.

    Raises FrameError where its mesh is missing or damaged, and what `exported_frame` raises.
    """
    key = request.keys.mesh(number)
    if not store.holds("mesh", key):
        raise FrameError("it was not simulated, so it is not exported", number)
    frame = store.read(
        "mesh", key, request.place("mesh", number), StoredFiles("mesh").reader(key, number=number)
    )
    return exported_frame(request.shot, frame)
