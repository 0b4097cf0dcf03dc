"""Pictures of edits that are not written yet: the current frame, small and at once, during a drag.

Look, lights, stage and camera only need drawing. A frame of another flow depends on all frames before it, and
these cannot be simulated in the time. The vertices of the frame that is shown are moved instead, by how far
the old flow and the new one carry points of the first frame apart. The surface is not resampled: the picture
is approximate.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np

from pipeline.arrays import AnyArray, Floats, Points
from pipeline.dailies.preview.animatic import size_for
from pipeline.dailies.preview.live_session import Drawn, LiveSession, camera_data
from pipeline.dailies.preview.shot_editor import ShotEditor
from pipeline.errors import UsageError
from pipeline.flow.flow_map import checked_displacement
from pipeline.mesh import TriangleMesh
from pipeline.mesh.normals import vertex_normals
from pipeline.production.render_inputs.framing import AHEAD, Framing, frame_all, with_stage_in_view
from pipeline.production.request.planning_cache import NO_CACHE
from pipeline.production.request.render_request import RenderRequest
from pipeline.shot import Motion
from pipeline.shot.yaml.edits import ValueEdit
from render.post.image import jpeg_bytes
from render.scene.camera import Camera
from render.scene.measure import SPEED

SIZE = (240, 135)
"""Pixels of a 16:9 picture: a quarter of those of the page's pictures."""

MOST_STEPS = 24
"""Steps in which points are carried to a frame; each spans several frames in a long shot."""

MOST_WEIGHTS = 1 << 22
"""Weights of carried points for vertices, at most, and with it their memory: 16 MiB."""

MOST_CARRIED, LEAST_CARRIED = 500, 60
"""Points that are carried: the more vertices, the fewer."""

FRAMED = 600
"""Points of a frame, about, by which a trial's camera is framed."""

FLOW = frozenset({"flows", "speed"})
DRAWN = frozenset({"camera", "look", "lights", "stage", "shutter", "view"})
"""Entries of a shot whose edits change the flow, or only the drawing."""

SMALL = "Small until you let go"
MOVED = "Approximate: moved by the change of the flow, not simulated yet"


@dataclass(frozen=True, eq=False)
class Carried:
    """Points of the first frame that the flow carries to another, and what each means for its vertices.

    start    (S, 3) in the first frame
    end      (S, 3) in the frame that is shown
    weights  (V, S) float32, for each vertex of that frame; their sum is 1
    """

    drawn: Drawn
    start: Points
    end: Points
    weights: AnyArray


@dataclass(eq=False)
class TrialPictures:
    """Draws the frame that a page shows, with edits of its shot file."""

    editor: ShotEditor
    session: LiveSession
    _carried: dict[int, Carried] = field(default_factory=dict)
    _extents: dict[tuple[int, str], AnyArray] = field(default_factory=dict)

    def picture(self, digest: str, edits: Sequence[ValueEdit], number: int) -> dict[str, Any]:
        """Return a JPEG in base64, its camera, and words about how exact it is.

        Raises StaleError where the file has another text, ShotError where the edits have no place or value in
        it, FrameError where the flow fails, and UsageError where there is nothing to draw yet.
        """
        self.session.hold()
        drawn = self.session.drawn(number)
        if drawn is None:
            raise UsageError(f"frame {number} is not simulated yet; the drag shows nothing until it is")
        request = _with_text(drawn.sketch.request, self.editor.trial(digest, edits))
        names = {edit.where[0] for edit in edits}
        if request.shot.subjects:
            raise UsageError("a drag shows shots of one subject; let go to see all of them")
        if names - FLOW - DRAWN or (request.measures_speed and names & FLOW):
            raise UsageError("this changes the mesh from its first frame on; let go to see it")
        arrays = self.session.arrays(drawn, number)
        if request.measures_speed and SPEED not in arrays:
            raise UsageError("the look shows speeds, which are measured when you let go")
        if names & FLOW:
            arrays = self._moved(drawn, arrays, request, number)
        framing = self._framing(drawn, request, number) if "camera" in names else drawn.framing
        sketch = replace(drawn.sketch, request=request, flow=False, burn_in=None)
        picture = sketch.picture(number, [arrays], framing, size_for(request.aspect, SIZE), "srgb")
        return {
            "picture": base64.b64encode(jpeg_bytes(picture)).decode(),
            "camera": camera_data(framing.camera, request.aspect),
            "words": MOVED if names & FLOW else SMALL,
        }

    def _moved(
        self, drawn: Drawn, arrays: Mapping[str, AnyArray], request: RenderRequest, number: int
    ) -> dict[str, AnyArray]:
        """Return the arrays of a frame, moved by the difference of two flows at points around."""
        carried = self._carried.get(number)
        if carried is None or carried.drawn is not drawn:
            carried = self._carry(drawn, arrays, number)
            self._carried = {number: carried}
        end = _carried_to(request.shot.motion, carried.start, number)
        vertices = arrays["vertices"] + carried.weights @ (end - carried.end).astype(np.float32)
        moved = {**arrays, "vertices": vertices}
        if "normals" in arrays:
            moved["normals"] = _turned(arrays, vertices)
        return moved

    def _carry(self, drawn: Drawn, arrays: Mapping[str, AnyArray], number: int) -> Carried:
        motion = drawn.sketch.request.shot.motion
        first = motion.frames.first
        begun = self.session.drawn(first)
        if begun is None:
            raise UsageError("the first frame is not simulated yet; the drag shows nothing until it is")
        vertices = self.session.arrays(begun, first)["vertices"]
        many = max(LEAST_CARRIED, min(MOST_CARRIED, MOST_WEIGHTS // len(arrays["vertices"])))
        start = vertices[:: -(-len(vertices) // many)].astype(np.float64)
        end = _carried_to(motion, start, number)
        return Carried(drawn, start, end, _weights(arrays["vertices"], end))

    def _framing(self, drawn: Drawn, request: RenderRequest, number: int) -> Framing:
        """Return the framing of a frame for another camera.

        It is computed for few points of the frames around, before and after the edit, and the true framing
        moves as these do.
        """
        numbers = [n for n in sorted(drawn.sketch.request.angles) if self.session.drawn(n) is not None]
        if request.follow == drawn.sketch.request.follow == 1.0:
            numbers = [n for n in numbers if abs(n - number) <= AHEAD]
        extents = [self._extent(n) for n in numbers]
        index = numbers.index(number)

        def framed(asked: RenderRequest) -> Framing:
            views = [asked.view(n) for n in numbers]
            return frame_all(views, lambda i: extents[i], asked.aspect, asked.follow)[index]

        before, after = framed(drawn.sketch.request), framed(request)
        camera = _corrected(after.camera, before.camera, drawn.framing.camera, request.view(number).position)
        return with_stage_in_view(replace(after, camera=camera), request.shot.picture.stage)

    def _extent(self, number: int) -> AnyArray:
        """Return a part of a frame's points (N, 3)."""
        drawn = self.session.drawn(number)
        assert drawn is not None, "only frames that are drawn are asked for"
        key = number, drawn.key
        if key not in self._extents:
            points = self.session.arrays(drawn, number)["vertices"]
            self._extents = {each: part for each, part in self._extents.items() if each[0] != number}
            self._extents[key] = points[:: -(-len(points) // FRAMED)]
        return self._extents[key]


def _with_text(request: RenderRequest, text: str) -> RenderRequest:
    """Return a request of the same frames for another text of its shot."""
    source = replace(request.source, text=text, inputs=None, cache=NO_CACHE)
    trial = replace(request, source=source)
    vars(trial)["angles"] = request.angles  # a trial has the same frames, and a summary takes long
    return trial


def _carried_to(motion: Motion, points: Points, number: int) -> Points:
    """Carry points (S, 3) of the first frame to another, in at most MOST_STEPS steps. Raises FrameError."""
    first = motion.frames.first
    stops = np.unique(np.linspace(first, number, min(MOST_STEPS, number - first) + 1).round()).tolist()
    for start, end in pairwise(stops):
        time, dt = motion.clock.between(start, end)
        points = checked_displacement(motion.flow, points, time, dt, int(end))
    return points


def _weights(vertices: AnyArray, points: Points) -> AnyArray:
    """Return the weight (V, S) of each point for each vertex: the inverse fourth power of their distance."""
    middle = points.mean(axis=0)
    near, places = (points - middle).astype(np.float32), (vertices - middle).astype(np.float32)
    size = float(np.ptp(near, axis=0).max()) or 1.0
    weights: AnyArray = places @ near.T  # every step in place: they are millions
    weights *= -2.0
    weights += (places**2).sum(axis=1)[:, None]
    weights += (near**2).sum(axis=1)
    np.maximum(weights, 0.0, out=weights)
    weights += np.float32((0.02 * size) ** 2)
    np.multiply(weights, weights, out=weights)
    np.reciprocal(weights, out=weights)
    weights /= weights.sum(axis=1, keepdims=True)
    return weights


def _turned(arrays: Mapping[str, AnyArray], vertices: AnyArray) -> AnyArray:
    """Return normals (V, 3), turned as those of the faces around them turn with moved vertices (V, 3)."""
    now, before = (
        vertex_normals(TriangleMesh(points.astype(np.float64), arrays["faces"]))
        for points in (vertices, arrays["vertices"])
    )
    normals: Floats = arrays["normals"] + (now - before)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.where(lengths > 0.1, normals / np.maximum(lengths, 0.1), now).astype(np.float32)


def _corrected(camera: Camera, rough: Camera, true: Camera, position: Any) -> Camera:
    """Return a camera that was framed by few points, corrected as one before the edit has to be."""
    if position is not None:
        return camera
    target = np.add(camera.target, np.subtract(true.target, rough.target))
    factor = np.linalg.norm(np.subtract(true.origin, true.target))
    factor /= np.linalg.norm(np.subtract(rough.origin, rough.target))
    origin = target + factor * np.subtract(camera.origin, camera.target)
    return replace(camera, origin=tuple(origin.tolist()), target=tuple(target.tolist()))
