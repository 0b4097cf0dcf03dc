"""Shot = motion + picture, and the film they are cut into.

Meshes depend on the motion alone, pictures on both: relighting never moves a vertex again.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipeline.flow import Flow
from pipeline.flow.choreography import Number, number_at
from pipeline.frames import FrameRange, FrameRate
from pipeline.resample import Thresholds
from pipeline.shot.clock import Clock
from pipeline.shot.data import NOT_DATA, as_data
from pipeline.shot.subject import Subject
from render.lights import LightRig
from render.look import Look
from render.stage import Stage


@dataclass(frozen=True)
class Motion:
    """All that decides the mesh of every frame.

    thresholds  None: resampling is off, and vertices only move
    """

    frames: FrameRange
    rate: FrameRate
    subject: Subject
    flow: Flow
    thresholds: Thresholds | None

    @property
    def clock(self) -> Clock:
        return Clock(self.frames, self.rate)

    def start_data(self) -> dict[str, Any]:
        """What decides the first frame, as JSON-able data: equal data, equal mesh.

        The budget of vertices is no part of it: it moves no vertex, and raising it goes on from the last
        frame that fitted.
        """
        thresholds = as_data(self.thresholds)
        if thresholds is not None:
            del thresholds["max_vertices"]
        return {"subject": as_data(self.subject), "thresholds": thresholds}

    def step_data(self, frame: int) -> Any:
        """What acts on the way into `frame`, JSON-able. A changed key tells from the key before it on."""
        return self.flow.acting(*self.clock.step(frame))


@dataclass(frozen=True)
class CameraPath:
    """Where the camera looks from in the course of the shot; framing finds the distance and the target.

    azimuth, elevation  radians, constant or keyed: 0 looks along −z, positive azimuth from the right
    field_of_view       radians, horizontal
    margin              share of the picture left empty on each side
    """

    azimuth: Number
    elevation: Number
    field_of_view: Number
    margin: float

    def at(self, time: float) -> tuple[float, float, float]:
        """Azimuth, elevation and field of view, radians, at a time in seconds."""
        return (
            number_at(self.azimuth, time),
            number_at(self.elevation, time),
            number_at(self.field_of_view, time),
        )


@dataclass(frozen=True)
class Picture:
    """All that decides how the meshes of a shot look."""

    look: Look
    camera: CameraPath
    lights: LightRig
    stage: Stage


@dataclass(frozen=True)
class Shot:
    """One shot of a film. `name` is the file's, without its ending."""

    name: str
    title: str
    motion: Motion
    picture: Picture
    intent: str = ""
    path: Path | None = field(default=None, metadata=NOT_DATA)

    @property
    def frames(self) -> FrameRange:
        return self.motion.frames

    @property
    def rate(self) -> FrameRate:
        return self.motion.rate


@dataclass(frozen=True)
class Film:
    """The edit: shots in order, and the words around them.

    title_seconds, credits_seconds  how long those cards stand; 0 leaves them out
    """

    title: str
    shots: tuple[Shot, ...]
    rate: FrameRate
    subtitle: str = ""
    credits: tuple[str, ...] = ()
    title_seconds: float = 3.0
    credits_seconds: float = 3.0
    path: Path | None = field(default=None, metadata=NOT_DATA)
