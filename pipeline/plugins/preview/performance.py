"""A shot that is simulated while some of its values are performed: on from a frame, with the meshes it has.

The shot is read once, with marked keys in place of the performed values; a live curve then takes the place of
each mark. Values of times that were simulated never change again, so new vertices are carried through the
same flow as all others, and the shot with the recorded values moves alike.
"""

from __future__ import annotations

import copy
import math
from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flowsculpt import TriangleMesh, UsageError
from flowsculpt.api.flows import Keyframes
from flowsculpt.api.frames import Framer, Framing, MeshFrame, RenderRequest, animate
from flowsculpt.api.shots import Clock, Motion, WrittenShot, to_yaml
from flowsculpt.pipeline.plugins.preview.live_session import Drawn, LiveSession
from flowsculpt.pipeline.plugins.preview.quick_shading import NORMAL, quick_shading
from flowsculpt.pipeline.plugins.preview.settable_values import SettableShot, SettableValue, settable_values
from flowsculpt.pipeline.plugins.preview.surface_stream import MeshSource, pieces_of
from flowsculpt.pipeline.plugins.preview.text_edits import Where, path_text
from flowsculpt.pipeline.plugins.preview.trial_pictures import corrected, with_speeds, with_text

MARKED = -1.0e6
"""Frame of the key that marks the first performed value; the next ones are marked a hundred frames before."""

LATE = 0.01  # frames after the last simulated time at which a sample counts that comes too late

FRAMED = 600  # points, about, by which a performed camera is framed

Row = tuple[float, ...]


@dataclass(eq=False)
class LiveCurve:
    """A value while it is performed: that of the file, and from the first sample on the samples.

    where      its path in the shot file
    given      (seconds) the value that the file gives it
    own        (frame of the film) the frame by the time of the value
    clock      of the shot
    times      of the samples, ascending, in frames of the value's own time
    simulated  the frame up to which values have been used
    count      samples that were added; where the value was held or taken up there are more times
    """

    where: Where
    given: Callable[[float], Row]
    own: Callable[[float], float]
    clock: Clock
    simulated: float
    source: str = "pointer"
    times: list[float] = field(default_factory=list)
    rows: list[Row] = field(default_factory=list)
    count: int = 0

    def add(self, frame: float, row: Row) -> None:
        """Record a sample at a frame of the film; one that comes too late counts from now on.

        Each row is there before its time, for a thread that draws meanwhile.
        """
        time = self.own(frame)
        if not self.times:
            start = max(self.simulated, time - 1.0)
            self.rows.append(self.given(self.clock.time(start)))
            self.times.append(start)
        elif self.times[-1] < self.simulated:  # the last one was held until here, as was seen
            self.rows.append(self.rows[-1])
            self.times.append(self.simulated)
        self.count += 1
        self.rows.append(row)
        self.times.append(max(time, self.simulated + LATE, self.times[-1]))

    def at(self, seconds: float) -> Row:
        """Return the value at a time: between samples linearly, and after the last one as that was."""
        if not self.times:
            return self.given(seconds)
        frame = self.clock.frames.first + seconds * float(self.clock.rate.fps)
        i = bisect_right(self.times, frame)
        if i == 0:
            return self.given(seconds)
        if i >= len(self.times):
            return self.rows[i - 1]
        start, end = self.times[i - 1], self.times[i]
        share = (frame - start) / (end - start)
        return tuple(a + share * (b - a) for a, b in zip(self.rows[i - 1], self.rows[i], strict=True))

    def part(self, index: int, number: float) -> Row:
        """Return the latest value with one of its numbers replaced."""
        row = list(self.rows[-1] if self.rows else self.given(self.clock.time(self.simulated)))
        row[index] = number
        return tuple(row)

    def close(self, frame: float) -> None:
        """End with the value that was held up to a frame of the film."""
        if self.times and self.times[-1] < self.own(frame):
            self.times.append(self.own(frame))
            self.rows.append(self.rows[-1])

    def freeze(self, frame: float) -> None:
        """Note that all values up to a frame of the film are used."""
        self.simulated = self.own(frame)


class _MarkedCurve(Keyframes):
    """A live curve in the units of the code, where a shot that was read has marked keys."""

    def __init__(self, live: LiveCurve, marked: Keyframes) -> None:
        super().__init__(marked.times, marked.values, marked.eases)
        handle = marked.left[1]
        assert handle is not None, "the marking key has a handle"
        object.__setattr__(self, "_live", live)
        object.__setattr__(self, "_factors", handle.values)

    def __hash__(self) -> int:
        return id(self)

    def __eq__(self, other: object) -> bool:
        return self is other

    def at(self, time: float) -> Row:
        live: LiveCurve = vars(self)["_live"]
        return tuple(f * v for f, v in zip(vars(self)["_factors"], live.at(time), strict=True))


def live_curve(shot: SettableShot, value: SettableValue, frame: int) -> LiveCurve:
    """Return the curve of a value that is to be performed from a frame on.

    Raises UsageError for a value that no keys can change, or whose time does not go on with the film's.
    """
    where, first = value.where, shot.clock.frames.first
    name = path_text(where)
    if not (value.can_change or value.curve):
        raise UsageError(f"{name} takes no keys, so it cannot be performed; perform a number or a vector")
    if where[0] == "speed":
        raise UsageError("speed gives the flows their time, so it cannot be performed; perform the flows")
    own = np.array(shot.own_frames(where))
    if (np.diff(own) <= 0).any():
        raise UsageError(
            f"{name} does not go by the time of the film: it is reversed, repeated or stopped. "
            "Perform it before you write that."
        )
    numbers = np.arange(first, first + len(own))
    curve = shot.curves.get(where)
    if curve is None:
        constant = tuple(map(float, value.value if isinstance(value.value, list) else [value.value]))
        given: Callable[[float], Row] = lambda seconds: constant  # noqa: E731
    else:
        given = curve.at

    def own_frame(film: float) -> float:
        return float(np.interp(film, numbers, own))

    return LiveCurve(where, given, own_frame, shot.clock, own_frame(frame))


class Performance:
    """A shot on from one of its frames, with live curves in place of some values.

    frame   the latest that is simulated
    curves  by their paths
    before  what the file has at each path; None where it leaves a value out
    """

    def __init__(self, session: LiveSession, drawn: Drawn, number: int, wheres: Sequence[Where]) -> None:
        """Begin at a frame that is drawn. Raises UsageError, and the errors of simulation."""
        self.session, self.drawn, self.frame = session, drawn, number
        request = drawn.sketch.request
        source = request.source
        shot = settable_values(source.path, source.text, source.settings)
        by_path = shot.by_path
        self.before = {each.where: each.value if each.is_given else None for each in shot.values}
        self.curves: dict[Where, LiveCurve] = {}
        for where in wheres:
            if where not in by_path:
                raise UsageError(f"{path_text(where)} is not in the shot any more; disarm it")
            self.curves[where] = live_curve(shot, by_path[where], number)
        text = _marked_text(request, list(self.curves.values()), shot.clock)
        marked = with_text(request, text)
        marks = {shot.clock.seconds(MARKED - 100 * i): curve for i, curve in enumerate(self.curves.values())}
        self._camera = _with_curves(marked.shot.picture.camera, marks)
        self._has_camera = any(where[0] == "camera" for where in self.curves)
        self._parts: list[_LivePart] = []
        for part, own in zip(request.parts, marked.parts, strict=True):
            stream = session.stream
            mesh = _without_normals(MeshSource(part, stream.store, stream.meshes, _ignore).at(number))
            motion = _with_curves(own.shot.motion, marks)
            self._parts.append(_LivePart(part, motion, mesh, animate(motion, mesh)))

    @property
    def last(self) -> int:
        return self.drawn.sketch.request.shot.frames.last

    def advance(self, position: float) -> int:
        """Simulate the frames up to a position, frames of the film; return how many.

        Raises FrameError where the flow or the resampling fails.
        """
        count = 0
        while self.frame + 1 <= min(position, self.last):
            self.frame += 1
            for curve in self.curves.values():
                curve.freeze(self.frame)
            for part in self._parts:
                part.step()
            count += 1
        return count

    def picture(
        self, position: float, size: tuple[int, int], rough: bool = False
    ) -> tuple[NDArray[Any], Framing]:
        """Draw the shot at a position between the latest frame and the next, and return its framing too."""
        surfaces = [part.arrays(position) for part in self._parts]
        framing = self._framing(position, surfaces)
        request = self.drawn.sketch.request
        sketch = replace(self.drawn.sketch, flow=False, burn_in=None, quick=True, rough=rough)
        number = min(max(self.frame, request.shot.frames.first), self.last)
        return sketch.picture(number, surfaces, framing, size, "srgb"), framing

    def values(self) -> list[tuple[Where, Row]]:
        """Return the paths and the latest numbers of all values that were moved."""
        return [(curve.where, curve.rows[-1]) for curve in self.curves.values() if curve.times]

    def meshes(self) -> list[MeshFrame]:
        """Return the mesh of each subject at the latest frame."""
        return [part.mesh for part in self._parts]

    def _framing(self, position: float, surfaces: Sequence[Mapping[str, np.ndarray]]) -> Framing:
        """Return camera and stage: those of the shot as it was, changed as far as the camera is performed."""
        request = self.drawn.sketch.request
        known = self.session.framing(self.frame) or self.drawn.framing
        if not self._has_camera:
            return known
        points = np.concatenate(
            [arrays["vertices"][:: -(-len(arrays["vertices"]) // FRAMED)] for arrays in surfaces]
        )
        follow, aspect = request.shot.picture.camera.follow, request.pictures.aspect

        def framed(view: Any) -> Framing:
            return Framer([view], lambda i: points, aspect, follow).all()[0]

        now = self._camera.at(request.shot.motion.clock.time(position))
        before = request.pictures.view(self.frame)
        return corrected(framed(now), framed(before), known, request, self.frame)


@dataclass(eq=False)
class _LivePart:
    """One subject of a performance.

    shown  number and arrays of the latest frame that can be drawn: one thread draws while another simulates
    """

    request: RenderRequest
    motion: Motion
    mesh: MeshFrame
    frames: Iterator[MeshFrame]
    shown: tuple[int, dict[str, np.ndarray]] = field(init=False)

    def __post_init__(self) -> None:
        self._shade()

    def step(self) -> None:
        """Simulate the next frame."""
        self.mesh = next(self.frames)
        self._shade()

    def _shade(self) -> None:
        pieces = pieces_of(self.request, self.mesh)
        self.shown = self.mesh.number, quick_shading(self.mesh, self.motion, pieces)

    def arrays(self, position: float) -> dict[str, np.ndarray]:
        """Return the arrays of the latest frame, carried on to a position after it."""
        number, arrays = self.shown
        if position > number and not self.motion.is_rigid and self.motion.animated is None:
            points = self.motion.carry(arrays["vertices"].astype(np.float64), number, position)
            arrays = {**arrays, "vertices": points.astype(np.float32)}
        if self.request.pictures.measures_speed:
            arrays = with_speeds(arrays, self.motion, number)
        return arrays


def _marked_text(request: RenderRequest, curves: Sequence[LiveCurve], clock: Clock) -> str:
    """Return the text of a shot with marked keys in place of values.

    The handle of the second key says what one unit of the file is in the code.
    """
    source = request.source
    data = copy.deepcopy(
        WrittenShot.read(source.path, source.text, source.settings, dict(source.beside) or None).source.data
    )
    for i, curve in enumerate(curves):
        row = list(curve.given(clock.time(curve.simulated)))
        value: Any = row if len(row) > 1 else row[0]
        ones: Any = [1.0] * len(row) if len(row) > 1 else 1.0
        frame = MARKED - 100 * i
        keys = {frame: {"value": value, "ease": "bezier"}, frame + 1: {"value": value, "left": [-1, ones]}}
        holder = data
        for step in curve.where[:-1]:
            if isinstance(holder, dict) and holder.get(step) is None:
                holder[step] = {}
            holder = holder[step]
        holder[curve.where[-1]] = {"keys": keys}
    return to_yaml(data)


def _with_curves(value: Any, marks: Mapping[float | None, LiveCurve]) -> Any:
    """Return plain data with live curves in place of marked keys; what has none within is the same."""
    if isinstance(value, Keyframes):
        live = marks.get(value.times[0]) if len(value.times) == 2 and value.left else None
        return value if live is None else _MarkedCurve(live, value)
    if is_dataclass(value) and not isinstance(value, type):
        found = {each.name: getattr(value, each.name) for each in fields(value) if each.init}
        changed = {name: now for name, old in found.items() if (now := _with_curves(old, marks)) is not old}
        return replace(value, **changed) if changed else value
    if isinstance(value, tuple | list) and not all(isinstance(item, int | float | str) for item in value):
        items = [_with_curves(item, marks) for item in value]
        if all(now is old for now, old in zip(items, value, strict=True)):
            return value
        return type(value)(*items) if hasattr(value, "_fields") else type(value)(items)
    if isinstance(value, dict):
        made = {name: _with_curves(item, marks) for name, item in value.items()}
        return made if any(made[name] is not item for name, item in value.items()) else value
    return value


def _without_normals(frame: MeshFrame) -> MeshFrame:
    """Return a frame whose normals are those of its faces, so that the flow need not carry them.

    To carry them takes two more points for each vertex, and changes no vertex.
    """
    if frame.copies is not None or frame.polygons is not None or NORMAL not in frame.own.attributes:
        return frame
    kept = {name: values for name, values in frame.own.attributes.items() if name != NORMAL}
    own = TriangleMesh(frame.own.vertices, frame.own.faces, kept, **frame.own.tagged_edges)
    return replace(frame, own=own)


def _ignore(progress: Any) -> None:
    """Take no notice of the progress within a frame."""


def is_finite(row: Sequence[float]) -> bool:
    """Tell whether all numbers of a value are finite."""
    return all(map(math.isfinite, row))
