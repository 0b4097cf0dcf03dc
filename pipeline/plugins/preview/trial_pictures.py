"""Pictures of edits that are not written yet: the current frame, small and at once, during a drag.

Look, lights, stage and camera only need drawing. A frame depends on all frames before it, and these cannot be
simulated while somebody drags. Where the flow changes, the vertices of the known frame are moved by how far
the old flow and the new one carry points of the first frame apart. Where the subject changes, a coarse mesh
of it is carried from the first frame to the one that is shown. Neither is resampled; what resampling and
smoothing change is hardly seen, so for an edit of these the frame is drawn as it is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from enum import IntEnum
from functools import cached_property
from itertools import pairwise
from threading import Lock
from typing import Any

import numpy as np

from flowsculpt import TriangleMesh, UsageError, vertex_normals
from flowsculpt.api.frames import Framer, Framing, MeshAngle, MeshFrame, RenderRequest, Shading, animate
from flowsculpt.api.materials import Surface
from flowsculpt.api.meshes import Floats
from flowsculpt.api.pictures import Camera
from flowsculpt.api.shots import Motion, Solid
from flowsculpt.pipeline.plugins.preview.animatic import size_for
from flowsculpt.pipeline.plugins.preview.live_session import Drawn, LiveSession, picture_data
from flowsculpt.pipeline.plugins.preview.shot_editor import ShotEditor
from flowsculpt.pipeline.plugins.preview.text_edits import ValueEdit, Where

MOST_STEPS = 24  # steps in which points are carried to a frame; each spans several frames in a long shot
MOST_WEIGHTS = 1 << 21  # weights of carried points for vertices, at most, and with it their memory: 8 MiB

MOST_CARRIED, LEAST_CARRIED = 500, 60
"""Points that are carried: the more vertices, the fewer."""

MOST_BUILT = 3000
"""Approximate vertices of a subject that is rebuilt, and of one whose vertices are carried individually."""


def carried_to(motion: Motion, points: Floats, number: int) -> Floats:
    """Carry points (S, 3) of the first frame to another, in at most MOST_STEPS steps. Raises FrameError."""
    first = motion.frames.first
    stops = np.unique(np.linspace(first, number, min(MOST_STEPS, number - first) + 1).round()).tolist()
    for start, end in pairwise(stops):
        points = motion.carry(points, start, end)
    return points


@dataclass(frozen=True, eq=False)
class CarriedPoints:
    """Points of the first frame that a flow carries to another, and what each means for its vertices.

    start    (S, 3) in the first frame
    end      (S, 3) in the frame that is shown
    weights  (V, S) float32, for each vertex of that frame
    arrays   of that frame
    normals  (V, 3), those of its faces around each vertex; None for points
    """

    start: Floats
    end: Floats
    weights: np.ndarray
    arrays: Mapping[str, np.ndarray]
    normals: Floats | None

    @classmethod
    def of(
        cls,
        motion: Motion,
        at_first: np.ndarray,
        arrays: Mapping[str, np.ndarray],
        number: int,
        subjects: int = 1,
    ) -> CarriedPoints:
        """Carry some of the first frame's vertices to one with these arrays: fewer for each of many subjects.

        Raises FrameError.
        """
        vertices = arrays["vertices"]
        start = _spread(at_first, _points_for(subjects * len(vertices))).astype(np.float64)
        end = carried_to(motion, start, number)
        normals = _normals(arrays, vertices) if "normals" in arrays else None
        return cls(start, end, _weights(vertices, end), arrays, normals)

    def moved(self, motion: Motion, number: int) -> dict[str, np.ndarray]:
        """Return the arrays of the frame, moved by the difference between this flow and another one.

        Raises FrameError where that flow fails.
        """
        end = carried_to(motion, self.start, number)
        vertices = self.arrays["vertices"] + _blended(self.weights, end - self.end)
        moved = {**self.arrays, "vertices": vertices}
        if self.normals is not None:
            now = _normals(self.arrays, vertices)
            moved["normals"] = _turned(self.arrays["normals"], self.normals, now)
        return moved


def built(motion: Motion, number: int, tessellate: int) -> dict[str, np.ndarray]:
    """Build the subject coarsely, a net cut as `tessellate` says, and return its arrays in a frame.

    Raises FrameError where the flow fails, and the errors of `Subject.build`.
    """
    if motion.is_rigid:  # to carry and turn them takes as little as to carry some points
        frame = next(frame for frame in animate(motion) if frame.number == number)
        return Shading.of(frame, motion.thresholds_at(number), 1).arrays()
    lattice = motion.subject.lattice
    frame = MeshFrame.at_rest(number, _coarse(motion), lattice)
    mesh = frame.mesh
    shading = Shading.of(frame, motion.thresholds_at(number), tessellate if lattice else 1)
    if len(mesh.vertices) <= 2 * MOST_BUILT:
        points = carried_to(motion, mesh.vertices, number)
    else:
        start = _spread(mesh.vertices, _points_for(len(mesh.vertices)))
        offsets = carried_to(motion, start, number) - start
        points = mesh.vertices + _blended(_weights(mesh.vertices, start), offsets)
    vertices, normals = shading.at(points)
    arrays = {**shading.arrays(), "vertices": vertices.astype(np.float32)}
    return arrays if normals is None else {**arrays, "normals": normals.astype(np.float32)}


STEP = 1 / 64
"""Frames over which points are moved to measure speed."""


def with_speeds(arrays: Mapping[str, np.ndarray], motion: Motion, number: int) -> dict[str, np.ndarray]:
    """Return arrays with the speed of their vertices, (V, 1) float32, scene units per second."""
    points = arrays["vertices"].astype(np.float64)
    moved = motion.carry(points, number, number + STEP)
    speed = np.linalg.norm(moved - points, axis=1, keepdims=True) / motion.rate.seconds(STEP)
    return {**arrays, Surface.SPEED: speed.astype(np.float32)}


def _coarse(motion: Motion) -> TriangleMesh:
    """Return the subject at rest with about MOST_BUILT vertices; models, clouds and nets as they are."""
    subject, copies = motion.subject, motion.copies
    if not isinstance(subject, Solid):
        return replace(motion, resampling=None).mesh_at_rest()
    area = float(subject.build().areas.sum())
    vertices = MOST_BUILT / (copies.count if copies else 1)
    edge = max(1.07 * (area / vertices) ** 0.5, 1e-9)  # equilateral triangles have half a vertex each
    return motion.mesh_at_rest(edge)


def _points_for(count: int) -> int:
    """Return how many points are carried for so many vertices."""
    return max(LEAST_CARRIED, min(MOST_CARRIED, MOST_WEIGHTS // max(1, count)))


def _spread(points: np.ndarray, count: int) -> np.ndarray:
    """Return about `count` of points (N, 3), spread evenly over their order."""
    return points[:: -(-len(points) // count)]


def _weights(vertices: np.ndarray, points: Floats) -> np.ndarray:
    """Return the weight (V, S) of each point for each vertex, float32: the inverse fourth power of their
    distance.
    """
    middle = points.mean(axis=0)
    near, places = (points - middle).astype(np.float32), (vertices - middle).astype(np.float32)
    least = np.float32((0.02 * (float(np.ptp(near, axis=0).max()) or 1.0)) ** 2)
    of_points = np.column_stack([-2.0 * near, (near**2).sum(axis=1) + least, np.ones_like(near[:, 0])])
    of_vertices = np.column_stack([places, np.ones_like(places[:, 0]), (places**2).sum(axis=1)])
    weights: np.ndarray = (
        of_vertices @ of_points.T
    )  # squared distances; every step in place: they are millions
    np.maximum(weights, least, out=weights)
    np.multiply(weights, weights, out=weights)
    return np.reciprocal(weights, out=weights)


def _blended(weights: np.ndarray, offsets: Floats) -> np.ndarray:
    """Return the offset (V, 3) float32 of each vertex: the mean of offsets (S, 3) by weights (V, S)."""
    summed = weights @ np.column_stack([offsets, np.ones(len(offsets))]).astype(np.float32)
    return np.asarray(summed[:, :3] / summed[:, 3:])


def _normals(arrays: Mapping[str, np.ndarray], vertices: np.ndarray) -> Floats:
    """Return the normals (V, 3) of the faces around vertices (V, 3)."""
    return vertex_normals(TriangleMesh(vertices.astype(np.float64), arrays["faces"]))


def _turned(normals: np.ndarray, before: Floats, now: Floats) -> np.ndarray:
    """Return normals (V, 3) float32, turned as those of the faces around them turn."""
    turned = normals + (now - before)
    lengths = np.linalg.norm(turned, axis=1, keepdims=True)
    return np.where(lengths > 0.1, turned / np.maximum(lengths, 0.1), now).astype(np.float32)


SIZE = (240, 135)  # pixels of a 16:9 picture: a quarter of those of the page's pictures
FRAMED = 600  # points of a frame, about, by which a trial's camera is framed
MOST_FRAMED = 64  # frames by which a trial's camera is framed that holds still over the whole shot


class Change(IntEnum):
    """Parts of a subject's surface that an edit changes, from none to all of it."""

    PICTURE = 0
    MESH = 1
    FLOW = 2
    SUBJECT = 3


CHANGES = {
    **dict.fromkeys(("camera", "look", "lights", "stage", "shutter"), Change.PICTURE),
    **dict.fromkeys(("resample", "smooth"), Change.MESH),
    **dict.fromkeys(("flows", "speed"), Change.FLOW),
    "subject": Change.SUBJECT,
}
"""Changes by the entries of a shot. Other entries of one of several subjects change that subject."""

WORDS = {
    Change.PICTURE: "Drawn small until you let go",
    Change.MESH: "Unchanged: the mesh is rebuilt when you let go",
    Change.FLOW: "Approximate: moved by the change of flow, not simulated yet",
    Change.SUBJECT: "Approximate: a coarse subject, not simulated yet",
}


@dataclass(eq=False)
class TrialPictures:
    """Draws the frame that a page shows, with edits of its shot file; safe to use from several threads."""

    editor: ShotEditor
    session: LiveSession
    _lock: Lock = field(default_factory=Lock)
    _carried: dict[str, tuple[Drawn, CarriedPoints]] = field(default_factory=dict)
    _extents: dict[tuple[int, str], np.ndarray] = field(default_factory=dict)

    def picture(self, digest: str, edits: Sequence[ValueEdit], number: int) -> dict[str, Any]:
        """Return a JPEG in base64, its camera, and words about how exact it is.

        Raises StaleError where the file has another text, ShotError where the edits have no place or value in
        it, FrameError where the flow fails, and UsageError where there is nothing to draw yet.
        """
        self.session.hold()
        with self._lock:
            drawn = self.session.drawn(number)
            if drawn is None:
                raise UsageError(f"frame {number} is not simulated yet; the drag shows nothing until it is")
            request = with_text(drawn.sketch.request, self.editor.trial(digest, edits))
            places, parts = [edit.where for edit in edits], drawn.sketch.request.parts
            if [part.source.subject for part in parts] != [part.source.subject for part in request.parts]:
                raise UsageError("other subjects are simulated first; the drag shows nothing until they are")
            changes = [change_of(places, part.source.subject) for part in parts]
            surfaces = [
                self._surface(drawn, before, after, change, number)
                for before, after, change in zip(parts, request.parts, changes, strict=True)
            ]
            framing = drawn.framing
            if Change.SUBJECT in changes:
                framing = self._framing_of_subject(drawn, request, surfaces, number)
            elif any(place[0] == "camera" for place in places):
                framing = self._framing(drawn, request, number)
        sketch = replace(drawn.sketch, request=request, flow=False, burn_in=None, quick=True)
        picture = sketch.picture(number, surfaces, framing, size_for(request.pictures.aspect, SIZE), "srgb")
        shown = picture_data(picture, framing.camera, request.pictures.aspect)
        return {**shown, "words": WORDS[max(changes)]}

    def prepare(self, where: Where, number: int) -> None:
        """Prepare the first picture of a drag: the page asks when the pointer goes down on a value."""
        self.session.hold()
        drawn = self.session.drawn(number)
        if drawn is None:
            return
        with self._lock:
            if where[0] == "camera":
                self._framing(drawn, drawn.sketch.request, number)
            for part in drawn.sketch.request.parts:
                if change_of([where], part.source.subject) == Change.FLOW:
                    self._carry(drawn, part, number)

    def _surface(
        self, drawn: Drawn, before: RenderRequest, after: RenderRequest, change: Change, number: int
    ) -> dict[str, np.ndarray]:
        """Return the arrays of one subject, whose requests before and after the edit are given."""
        motion = after.shot.motion
        if change == Change.SUBJECT or (change == Change.FLOW and motion.is_rigid):
            arrays = built(motion, number, after.shot.picture.tessellate)
        elif change == Change.FLOW:
            arrays = self._carry(drawn, before, number).moved(motion, number)
        else:
            arrays = self.session.stream.arrays(before, number)
        if after.pictures.measures_speed and (change >= Change.FLOW or Surface.SPEED not in arrays):
            arrays = with_speeds(arrays, motion, number)
        return arrays

    def _carry(self, drawn: Drawn, part: RenderRequest, number: int) -> CarriedPoints:
        """Return points that the flow of one subject carries to a frame, kept for the next picture."""
        name = part.source.subject
        known, carried = self._carried.get(name, (None, None))
        if carried is None or known is not drawn:
            arrays, subjects = self.session.stream.arrays(part, number), len(drawn.sketch.request.parts)
            carried = CarriedPoints.of(part.shot.motion, self._at_first(part), arrays, number, subjects)
            self._carried[name] = drawn, carried
        return carried

    def _at_first(self, part: RenderRequest) -> np.ndarray:
        """Return the vertices of a subject in the first frame."""
        first = part.shot.motion.frames.first
        if not self.session.stream.knows(part, first):
            begun = self.session.drawn(first)
            if begun is None:
                raise UsageError("the first frame is not simulated yet; the drag shows nothing until it is")
            name = part.source.subject
            part = next(each for each in begun.sketch.request.parts if each.source.subject == name)
        return self.session.stream.arrays(part, first)["vertices"]

    def _framing(self, drawn: Drawn, request: RenderRequest, number: int) -> Framing:
        """Return the framing of a frame for another camera.

        It is computed for few points of the frames around, before and after the edit, and the true framing
        moves as these do.
        """
        numbers = sorted(drawn.sketch.request.angles)
        if request.shot.picture.camera.follow == drawn.sketch.request.shot.picture.camera.follow == 1.0:
            numbers = [n for n in numbers if abs(n - number) <= Framer.AHEAD]
        else:
            numbers = [n for n in numbers if n == number or not n % -(-len(numbers) // MOST_FRAMED)]
        numbers = [n for n in numbers if self.session.drawn(n) is not None]
        extents = [self._extent(n) for n in numbers]
        index = numbers.index(number)

        def framed(asked: RenderRequest) -> Framing:
            views, follow = [asked.pictures.view(n) for n in numbers], asked.shot.picture.camera.follow
            return Framer(views, lambda i: extents[i], asked.pictures.aspect, follow).all()[index]

        return corrected(framed(request), framed(drawn.sketch.request), drawn.framing, request, number)

    def _framing_of_subject(
        self, drawn: Drawn, request: RenderRequest, surfaces: Sequence[Mapping[str, np.ndarray]], number: int
    ) -> Framing:
        """Return the framing of a frame for another subject: it moves as one by this frame alone would."""
        known = [self.session.stream.arrays(part, number) for part in drawn.sketch.request.parts]

        def framed(asked: RenderRequest, seen: Sequence[Mapping[str, np.ndarray]]) -> Framing:
            points = np.concatenate([arrays["vertices"] for arrays in seen])
            views, follow = [asked.pictures.view(number)], asked.shot.picture.camera.follow
            return Framer(views, lambda i: points, asked.pictures.aspect, follow).all()[0]

        before = framed(drawn.sketch.request, known)
        return corrected(framed(request, surfaces), before, drawn.framing, request, number)

    def _extent(self, number: int) -> np.ndarray:
        """Return a part of a frame's points (N, 3)."""
        drawn = self.session.drawn(number)
        assert drawn is not None, "only frames that are drawn are asked for"
        key = number, drawn.key
        if key not in self._extents:
            parts = drawn.sketch.request.parts
            each = [self.session.stream.arrays(part, number)["vertices"] for part in parts]
            self._extents = {place: part for place, part in self._extents.items() if place[0] != number}
            self._extents[key] = np.concatenate([p[:: -(-len(parts) * len(p) // FRAMED)] for p in each])
        return self._extents[key]


def change_of(places: Sequence[Where], subject: str) -> Change:
    """Return what edits at some paths change of a subject; its name is empty where it is the only one.

    Raises UsageError for a path whose edits have no picture.
    """
    found = [Change.PICTURE]
    for place in places:
        if place[0] == "subjects" and len(place) > 2:
            if place[1] == subject:
                found.append(CHANGES.get(str(place[2]), Change.SUBJECT))
        elif place[0] in CHANGES:
            found.append(CHANGES[str(place[0])])
        else:
            raise UsageError(f"{place[0]} shows when you let go")
    return max(found)


@dataclass(frozen=True)
class _TrialRequest(RenderRequest):
    """A request of the frames of another one, for another text of its shot.

    Its manifest is not needed: planning all frames of a long shot takes too long for a drag.
    """

    before: RenderRequest | None = None

    @cached_property
    def parts(self) -> tuple[RenderRequest, ...]:
        names = [part.subject for part in self.shot.subjects]
        return tuple(replace(self, source=self.source.of_subject(name)) for name in names) or (self,)

    @cached_property
    def angles(self) -> dict[int, MeshAngle]:
        return self.before.angles if self.before is not None else super().angles


def with_text(request: RenderRequest, text: str) -> RenderRequest:
    """Return a request of the same frames for another text of its shot."""
    source = request.source.with_text(text)
    own = {each.name: getattr(request, each.name) for each in fields(RenderRequest)}
    return _TrialRequest(**{**own, "source": source}, before=request)


def corrected(after: Framing, before: Framing, true: Framing, request: RenderRequest, number: int) -> Framing:
    """Return a framing by few points of an edited shot, corrected as that before the edit has to be."""
    stands, stood, is_true = after.placement, before.placement, true.placement
    origin = np.add(stands.origin, np.subtract(is_true.origin, stood.origin)).tolist()
    placement = replace(stands, origin=tuple(origin), size=stands.size * is_true.size / stood.size)
    camera = after.camera
    if request.pictures.view(number).position is None:
        camera = _corrected_camera(camera, before.camera, true.camera)
    stage, aspect = request.shot.picture.stage, request.pictures.flat_aspect
    return Framing(camera, placement).with_stage_in_view(stage, aspect)


def _corrected_camera(camera: Camera, rough: Camera, true: Camera) -> Camera:
    """Return a camera moved and brought nearer as one has to be that is as rough."""
    target = np.add(camera.target, np.subtract(true.target, rough.target))
    factor = np.linalg.norm(np.subtract(true.origin, true.target))
    factor /= np.linalg.norm(np.subtract(rough.origin, rough.target))
    origin = target + factor * np.subtract(camera.origin, camera.target)
    return replace(camera, origin=tuple(origin.tolist()), target=tuple(target.tolist()))
