"""The scene of one picture: its subjects, its camera and its stage, at its moment and around it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.production.render_inputs.facets import diced, pieces_without_facets
from pipeline.production.render_inputs.framing import Framing
from pipeline.production.render_inputs.view_geometry import rotate_y
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store import readers
from pipeline.production.tasks.job import Context
from render.frame.sample_batches import ShutterInterval
from render.scene.aovs import COPY
from render.scene.measure import SPEED
from render.scene.scene import SUBJECT, Geometry, MotionSample, SceneSubject
from render.scene.spheres import Spheres
from render.scene.surface import Surface, outlines

if TYPE_CHECKING:  # what only some pictures need takes half a second
    from pipeline.production.render_inputs.shading import Shading, Shown, SurfaceMotion


def subject_looks(request: RenderRequest, number: int, sample: MotionSample) -> list[SceneSubject]:
    """Return the subjects of a sample with the names and looks that they have in a frame."""
    subjects = zip(request.parts, sample.subjects, strict=True)
    return [
        SceneSubject(part.source.subject or SUBJECT, shown, part.picture(number).look)
        for part, shown in subjects
    ]


@dataclass(frozen=True)
class ShownFrame:
    """The subjects, camera and stage of one picture, at the picture and around it."""

    context: Context
    number: int
    framings: Mapping[int, Framing]

    def moments(self) -> tuple[MotionSample, ShutterInterval | None, MotionSample | None]:
        """Return the picture's moment, its shutter, and the next picture's moment; None for what it lacks."""
        request, number, framing = self.context.request, self.number, self.framings[self.number]
        firsts = _first_copies(request)
        subjects = [
            _ShownSubject(self.context, part, number, framing, first_copy=firsts.get(part.source.subject, 0))
            for part in request.parts
        ]
        if request.turntable is not None and len(subjects) > 1:
            around = np.concatenate([subject.bounds() for subject in subjects])
            subjects = [replace(subject, around=around) for subject in subjects]
        sample = _sample(framing, [subject.now() for subject in subjects])
        if not request.offsets(number):
            return sample, None, None
        from pipeline.production.render_inputs.shading import framing_at

        def at(offset: float) -> MotionSample:
            there = framing_at(self.framings, number, offset)
            return _sample(there, [subject.at(offset) for subject in subjects])

        opened = request.open_at(number)
        following = at(1.0) if "motion" in request.aovs.extra else None
        return sample, None if opened is None else ShutterInterval(*opened, at), following


def _sample(framing: Framing, subjects: list[Geometry]) -> MotionSample:
    return MotionSample(subjects[0], framing.placement, framing.camera, tuple(subjects[1:]))


def _first_copies(request: RenderRequest) -> dict[str | None, int]:
    """Return the number of the first copy of each subject with numbered copies, from 1 on."""
    counts = np.cumsum([1, *request.copies.values()])
    return dict(zip(request.copies, counts.tolist(), strict=False))


@dataclass(frozen=True)
class _ShownSubject:
    """One subject of a picture.

    request  of the subject alone
    framing  of the picture
    around   points of all subjects, which turn together about the axis of their bounds; None for one alone
    first_copy  number of its first copy if copies are numbered; else 0
    """

    context: Context
    request: RenderRequest
    number: int
    framing: Framing
    around: AnyArray | None = None
    first_copy: int = 0

    def bounds(self) -> AnyArray:
        """Return the lowest and the highest coordinates (2, 3) of its vertices, not turned."""
        points = self._stored_arrays["vertices"]
        return np.stack([points.min(axis=0), points.max(axis=0)])

    def now(self) -> Geometry:
        """Return the subject at the moment of the picture."""
        spin, vertices, normals = self._spin, self._arrays["vertices"], self._arrays.get("normals")
        turned_normals = None if normals is None else rotate_y(normals, spin, about_origin=True)
        return self._subject((rotate_y(vertices, spin, around=self.around), turned_normals))

    def at(self, offset: float) -> Geometry:
        """Return the subject so many frames from the picture."""
        return self._subject(self._motion.at(offset))

    @property
    def _mesh(self) -> int:
        return self.request.angles[self.number].mesh

    @property
    def _spin(self) -> float:
        return self.request.angles[self.number].spin

    @cached_property
    def _shading(self) -> Shading:
        """The shading of the mesh, diced for this picture where the shot asks for that."""
        from pipeline.production.tasks.meshes import shading_of

        request = self.request
        shading, pixels = shading_of(self.context, request, self._mesh), request.shot.picture.dicing
        if pixels is None:
            return replace(shading, pieces=self._pieces)
        return shading.cut_for(self.framing.camera, request.quality, pixels, self._spin, self.around)

    @cached_property
    def _stored_arrays(self) -> Mapping[str, AnyArray]:
        """The arrays of the surface as `smooth_normals` stored them."""
        request = self.request
        key, place = request.normals_key(self._mesh), request.place("normals", self._mesh)
        return self.context.read("normals", key, place, readers.arrays(key))

    @cached_property
    def _pieces(self) -> int:
        """The pieces of each edge, where the shot does not ask for dicing."""
        request, arrays = self.request, self._stored_arrays
        picture = request.shot.picture
        if not picture.hide_facets or "faces" not in arrays:
            return picture.tessellate
        camera = self.framing.camera
        return pieces_without_facets(arrays, camera, request.quality, self._spin, self.around)

    @cached_property
    def _arrays(self) -> Mapping[str, AnyArray]:
        """The arrays of the surface, with the edges of the resampled mesh where a wireframe shows them."""
        request = self.request
        picture = request.picture(self.number)
        if picture.dicing is None:
            arrays, pieces = self._stored_arrays, self._pieces
            if picture.hide_facets and "faces" in arrays:
                arrays = diced(arrays, pieces)
        else:
            arrays, pieces = self._shading.arrays(), self._shading.pieces
        if picture.look.wireframe is None or "faces" not in arrays:
            return arrays
        from pipeline.shot.point_subjects import ControlNet

        if isinstance(request.shot.motion.subject, ControlNet):
            return arrays  # all edges of a net are drawn
        return {**arrays, "edges": outlines(arrays["faces"], pieces)}

    @cached_property
    def _motion(self) -> SurfaceMotion:
        from pipeline.production.render_inputs.shading import flow_motion, turntable_motion

        request = self.request
        motion = request.shot.motion
        if request.turntable is None:
            return flow_motion(motion, self._shading)
        vertices, normals = self._arrays["vertices"], self._arrays.get("normals")
        turn = request.turntable.step(self.number)
        return turntable_motion(vertices, normals, self._spin, turn, float(motion.rate.fps), self.around)

    @cached_property
    def _attributes(self) -> dict[str, AnyArray]:
        """The vertex attributes that AOVs need, mattes of copies, and a look that shows speeds."""
        request, attributes = self.request, {}
        if request.offsets(self.number):
            motion = self._motion
            values: dict[str, Callable[[], AnyArray]] = {
                "velocity": motion.velocity,
                "before": partial(motion.displacement, -1.0),
                "after": partial(motion.displacement, 1.0),
            }
            names = [name for name in request.aovs.extra if name in values]
            attributes = {name: values[name]().astype(np.float32) for name in names}
        if self.first_copy:
            indices = request.shot.motion.copy_indices(self._arrays["material"].astype(np.float64))
            attributes[COPY] = (indices[:, None] + self.first_copy).astype(np.float32)
        if not request.measures_speed:
            return attributes
        from pipeline.production.render_inputs.shading import speeds

        return {**attributes, SPEED: speeds(request.shot.motion, self._shading)}

    def _subject(self, shown: Shown) -> Geometry:
        """Return the surface, or the spheres, with these vertices and normals."""
        arrays, (points, normals) = self._arrays, shown
        vertices, material = points.astype(np.float32), arrays["material"]
        if normals is None:
            return Spheres(vertices, arrays["radii"], self._attributes, material)
        edges, faces = arrays.get("edges"), arrays["faces"]
        return Surface(vertices, normals.astype(np.float32), faces, self._attributes, material, edges)
