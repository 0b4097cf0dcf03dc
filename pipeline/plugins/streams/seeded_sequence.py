"""What seeds have released in every frame of a shot."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from flowsculpt import MeshError, PolygonMesh, Streamlines, TriangleMesh
from flowsculpt.api.materials import with_known
from flowsculpt.api.meshes import Floats
from flowsculpt.api.shots import SurfaceSequence
from flowsculpt.pipeline.plugins.streams.data_units import facts_of_data
from flowsculpt.pipeline.plugins.streams.sheet_cuts import cut_below
from flowsculpt.pipeline.plugins.streams.shells import shell
from flowsculpt.pipeline.plugins.streams.stream_values import Measured, Parcels, StreamValues
from flowsculpt.pipeline.plugins.streams.travels import Frozen
from flowsculpt.pipeline.plugins.streams.value_samples import ValueSamples

VERSION = 6
"""Raised when equal settings give other surfaces."""

CUT = 0.5
"""The weight of a region at which surfaces end: points slow down from 1, and stop before 0."""


class Weights(Protocol):
    """A region: 1 inside, less in its falloff, and 0 outside."""

    def weight(self, points: Floats, time: float) -> Floats: ...

    def cache_data(self, time: float) -> Any: ...


class Released(Protocol):
    """A surface, or lines, of points that seeds release."""

    @property
    def mesh(self) -> TriangleMesh: ...

    def grow(self, until: float) -> None: ...

    def grow_back(self, until: float) -> None: ...

    def velocities(self) -> Floats: ...

    def parcels(self) -> Parcels: ...

    def displaced(self, seeds: Floats, ages: Floats) -> Floats: ...


@dataclass(frozen=True, eq=False)
class SeededSequence(SurfaceSequence):
    """A stream, path or streak surface, or lines, over the frames of a shot.

    word       what the shot calls it
    make       returns it before it has grown, of a flow and the seconds when points are released first
    settings   all that decides it besides the flow and the times, JSON-able
    flow       moves points along the velocities
    times      seconds of the flow at the frames
    begin      when points are released first; None if each frame shows streamlines of its own
    length     seconds that points travel
    direction  of streamlines
    thickness  of a shell about a surface, units
    values     what is measured at its points; None for nothing
    region     outside of which `flow` does not move points: surfaces end there
    """

    word: str
    make: Callable[[Streamlines, float], Released]
    settings: Any
    flow: Streamlines
    times: tuple[float, ...]
    begin: float | None
    length: float = math.inf
    direction: str = "forwards"
    thickness: float = 0.0
    values: StreamValues | None = None
    region: Weights | None = None
    _known: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        back = [number for number, step in enumerate(np.diff(self.times), 2) if step < 0.0]
        if back and self.begin is not None:
            raise MeshError(
                f"the flow runs backwards into frame {back[0]} of {len(self.times)}, and {self.word} "
                f"only grows. Keep speed above 0, or write stream_{self.word.partition('_')[2]}."
            )

    @property
    def path(self) -> Path:
        return Path(self.word)

    @property
    def digest(self) -> str:
        known = [
            VERSION,
            self.word,
            self.settings,
            self.begin,
            repr(self.length),
            self.direction,
            self.thickness,
            *([] if self.values is None else [self.values.factor]),
            self.region is not None,
        ]
        return hashlib.sha256(json.dumps(known).encode()).hexdigest()

    @property
    def files(self) -> tuple[tuple[Path, str], ...]:
        return ()

    @property
    def keeps_faces(self) -> bool:
        return False

    def points(self, seconds: float) -> Floats:
        raise AssertionError("its faces change")

    def surface(self, seconds: float) -> tuple[PolygonMesh, Floats | None]:
        frame = self._frame(seconds)
        released = self._streamlines(frame) if self.begin is None else self._grown(frame, self.begin)
        mesh = released.mesh
        if self.values is not None:
            values = self._measured(frame, released, self.values)
            self._samples.note(frame, values)
            mesh = mesh.with_attributes(values=with_known(values))
        velocities = None if self.begin is None else released.velocities()
        if self.region is not None:
            mesh, velocities = self._inside(mesh, velocities, self.region.weight(mesh.vertices, seconds))
        if self.thickness:
            mesh = shell(mesh, self.thickness)
            velocities = None if velocities is None else np.concatenate([velocities, velocities])
        return PolygonMesh.from_triangles(mesh), velocities

    def _measured(self, frame: int, released: Released, values: StreamValues) -> Floats:
        """Return the values (V,) of the vertices of the last mesh in a frame."""
        if self.begin is None:
            now = self.times[frame]
            if values.numbers is not None:
                values = replace(values, numbers=Frozen(values.numbers, now))
            return Measured(values, keeps=False).of(released, Frozen(self.flow.field, now))
        if (known := self._known.get("measured")) is None or known[0] is not released:
            known = released, Measured(values, keeps=self.word.startswith("path"))
            self._known["measured"] = known
        return known[1].of(released, self.flow.field)

    @cached_property
    def _samples(self) -> ValueSamples:
        """What the frames so far have measured."""
        return ValueSamples(len(self.times), lambda: [self.data(time) for time in self.times])

    def quantiles(self, shares: Sequence[float]) -> Sequence[float]:
        if (known := self._samples.quantiles(shares)) is not None:
            return known
        whole = replace(self, _known={})  # what has grown here goes on as it is
        for time in self.times:
            whole.surface(time)
        found = whole._samples.quantiles(shares)
        if found is None:
            raise MeshError(
                f"{self.word} measures {whole.facts(0.0)['values']}, which no frame has. Write others."
            )
        return found

    def facts(self, seconds: float) -> dict[str, Any]:
        known, values = facts_of_data(self.flow.field, seconds), self.values
        return known if values is None else {**known, "values": values.label, "unit": values.unit}

    def _inside(
        self, mesh: TriangleMesh, velocities: Floats | None, weights: Floats
    ) -> tuple[TriangleMesh, Floats | None]:
        """Return the part of a surface where weights (V,) are at least CUT, and its velocities."""
        if weights.min() >= CUT:
            return mesh, velocities
        if velocities is not None:
            mesh = mesh.with_attributes(velocity=velocities)
        part = cut_below(mesh, weights, CUT)
        if not len(part.faces):
            raise MeshError(f"all of the {self.word} is outside of the region of within. Make it larger.")
        kept = {name: values for name, values in part.attributes.items() if name != "velocity"}
        return TriangleMesh(part.vertices, part.faces, kept), part.attributes.get("velocity")

    def data(self, seconds: float) -> Any:
        frame = self._frame(seconds)
        if self.begin is None:
            return [self.digest, *self._step(self.times[frame], 0.0)]
        return [self.digest, self._history(frame, self.begin)]

    def _history(self, frame: int, begin: float) -> str:
        """Return the digest of all that moved points up to a frame, by that of the frame before."""
        known: list[str] = self._known.setdefault("history", [])
        ends = [begin, *self.times]
        for each in range(len(known), frame + 1):
            step = self._step(ends[each], ends[each + 1] - ends[each])
            text = json.dumps([known[-1] if known else "", *step])
            known.append(hashlib.sha256(text.encode()).hexdigest())
        return known[frame]

    def _step(self, time: float, dt: float) -> list[Any]:
        """Return all that decides what happens in a step: what moves points and, if any, their variable."""
        numbers = self.values.numbers if self.values else None
        measured = [] if numbers is None else [Streamlines(numbers).cache_data(time, dt)]
        return [self.flow.cache_data(time, dt), *measured]

    def _frame(self, seconds: float) -> int:
        return int(np.argmin(np.abs(np.array(self.times) - seconds)))

    def _grown(self, frame: int, begin: float) -> Released:
        """Return what a frame shows, grown on from what the frame before showed, if that is known."""
        last, released = self._known.get("grown", (-1, None))
        if released is None or last > frame:
            last, released = -1, self.make(self.flow, begin)
        end = math.inf if self.word.startswith("streak") else begin + self.length  # streaks lose their ends
        for each in range(last + 1, frame + 1):
            released.grow(min(self.times[each], end))
        self._known["grown"] = frame, released
        return released

    def _streamlines(self, frame: int) -> Released:
        """Return what a frame shows of streamlines; while the velocities stay the same, so do they."""
        time = self.times[frame]
        now = json.dumps(self.flow.cache_data(time, 0.0))
        known, released = self._known.get("streamlines", ("", None))
        if known != now:
            released = self.make(Streamlines(Frozen(self.flow.field, time)), 0.0)
            if self.direction != "backwards":
                released.grow(self.length)
            if self.direction != "forwards":
                released.grow_back(-self.length)
            self._known["streamlines"] = now, released
        return released
