"""What a shot file says under `camera`. Angles are degrees there, lenses in millimetres."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Any

from pydantic import Discriminator, Field, Tag, ValidationInfo, field_validator

from pipeline.flow.keyframes import Number, VectorParameter, vector_at
from pipeline.shot.camera import FULL_FRAME, CameraPath
from pipeline.shot.checks.file_checks import Problem
from pipeline.shot.clock import Clock
from pipeline.shot.documents.curves import (
    ABOVE_0,
    ANYWHERE,
    Bounds,
    Key,
    Keyed,
    NumberField,
    OverTime,
    OverTimeTriple,
    PlaceField,
    PositiveField,
    Share,
    form,
    number,
    place,
    stays,
)
from pipeline.shot.documents.fields import DEGREE, Document, Positive, Triple, one_of
from pipeline.shot.yaml.parse_context import finding
from pipeline.shot.yaml.source import Source

SAFE_AREAS = {"action": 0.035, "title": 0.05}
"""Margins by name: what SMPTE ST 2046-1 keeps free at each side around actions and around titles."""

SAME = (
    ("focal_length", "field_of_view"),
    ("dolly", "distance"),
    *(("position", name) for name in ("azimuth", "elevation", "orbit", "distance", "dolly")),
)
"""Names that say the same in two ways."""

OpenAngle = Annotated[Positive, Field(lt=180)]
AngleField = Annotated[
    Annotated[OpenAngle, Tag("plain")]
    | Annotated[OpenAngle, Tag("list")]
    | Annotated[Keyed[OpenAngle], Tag("keyed")]
    | Annotated[OverTime, Tag("formula")],
    Discriminator(form),
    stays(Bounds(math.ulp(0.0), math.nextafter(180.0, 0.0), "above 0 and below 180")),
]

SafeArea = Annotated[str, one_of(SAFE_AREAS, "safe area")]
Margin = Annotated[float, Field(ge=0, lt=0.5)]
MarginField = Annotated[
    Annotated[Margin, Tag("plain")]
    | Annotated[Margin, Tag("list")]
    | Annotated[Keyed[Margin], Tag("keyed")]
    | Annotated[OverTime, Tag("formula")]
    | Annotated[SafeArea, Tag("named")],
    Discriminator(lambda value: "named" if isinstance(value, str) else form(value)),
    stays(Bounds(0.0, math.nextafter(0.5, 0.0), "at 0 or above and below 0.5")),
]


def _focus_form(value: Any) -> str:
    """How a focus is said: `subject`, a distance or a place, and both of these in time."""
    if isinstance(value, str):
        return "named"
    kind = form(value)
    if kind == "keyed":
        keys = value.get("keys") if isinstance(value, dict) else None
        first = next(iter(keys.values()), None) if isinstance(keys, dict) else None
        first = first.get("value") if isinstance(first, dict) else first
        return "keyed places" if isinstance(first, list) else "keyed"
    if kind == "formula":
        return "formulas" if isinstance(value["formula"], list) else "formula"
    return kind


FocusField = Annotated[
    Annotated[Positive, Tag("plain")]
    | Annotated[Triple, Tag("list")]
    | Annotated[Keyed[Positive], stays(ABOVE_0), Tag("keyed")]
    | Annotated[Keyed[Triple], stays(ANYWHERE), Tag("keyed places")]
    | Annotated[OverTime, stays(ABOVE_0), Tag("formula")]
    | Annotated[OverTimeTriple, stays(ANYWHERE), Tag("formulas")]
    | Annotated[str, one_of(("subject",), "thing to focus on"), Tag("named")],
    Discriminator(_focus_form),
]


class CameraDocument(Document):
    """Angles in degrees. What is empty is as if it were not there, so that a shot can take back what it
    rests on says."""

    azimuth: NumberField | None = -30.0
    elevation: NumberField | None = 14.0
    orbit: NumberField | None = None
    field_of_view: AngleField | None = 26.0
    focal_length: PositiveField | None = None
    sensor_width: Positive = FULL_FRAME
    margin: MarginField = 0.08
    follow: Share = 1.0
    dolly: PositiveField | None = None
    distance: PositiveField | None = None
    target: PlaceField | None = None
    position: PlaceField | None = None
    roll: NumberField = 0.0
    aperture: PositiveField | None = None
    focus: FocusField | None = None
    unit: Positive | None = None

    @field_validator("position")
    @classmethod
    def _looks_somewhere(cls, position: Any, info: ValidationInfo) -> Any:
        """A camera does not stand where it looks to."""
        clock: Clock | None = (info.context or {}).get("clock")
        target = info.data.get("target")
        if clock is None or position is None or target is None or not _timely(clock, position, target):
            return position
        origin, aim = place(position, clock), place(target, clock)
        for frame in clock.frames:
            here, there = (vector_at(each, clock.time(frame)) for each in (origin, aim))
            if math.dist(here, there) <= 1e-9 * max(1.0, math.hypot(*here)):
                raise finding(
                    f"at frame {frame} the camera stands at its own target, {list(here)}; it has nowhere to "
                    "look. Move one of them."
                )
        return position

    def build(self, clock: Clock) -> CameraPath:
        return CameraPath(
            azimuth=number(-30.0 if self.azimuth is None else self.azimuth, clock, DEGREE),
            elevation=number(14.0 if self.elevation is None else self.elevation, clock, DEGREE),
            field_of_view=number(26.0 if self.field_of_view is None else self.field_of_view, clock, DEGREE),
            margin=number(SAFE_AREAS[self.margin] if isinstance(self.margin, str) else self.margin, clock),
            focal_length=_number(self.focal_length, clock),
            sensor_width=float(self.sensor_width),
            roll=number(self.roll, clock, DEGREE),
            orbit=number(0.0 if self.orbit is None else self.orbit, clock, DEGREE),
            dolly=number(1.0 if self.dolly is None else self.dolly, clock),
            distance=_number(self.distance, clock),
            target=None if self.target is None else place(self.target, clock),
            position=None if self.position is None else place(self.position, clock),
            follow=float(self.follow),
            aperture=_number(self.aperture, clock),
            focus=_focus(self.focus, clock),
            unit=None if self.unit is None else float(self.unit),
        )


def _number(value: float | Keyed[Any] | OverTime | None, clock: Clock) -> Number | None:
    return None if value is None else number(value, clock)


def _focus(value: Any, clock: Clock) -> Number | VectorParameter | None:
    if value is None or isinstance(value, str):
        return None
    first = next(iter(value.keys.values())) if isinstance(value, Keyed) else value
    first = first.value if isinstance(first, Key) else first
    of_places = isinstance(first, list | OverTimeTriple)
    return place(value, clock) if of_places else number(value, clock)


def _timely(clock: Clock, *values: Any) -> bool:
    """Whether keys are at moments that can be; where not, that is told by others."""
    return all(None not in map(clock.seconds, value.keys) for value in values if isinstance(value, Keyed))


def camera(source: Source) -> Iterator[Problem]:
    """A check like those of `checks`: nothing about a camera is said in two ways."""
    said = source.get("camera")
    if not isinstance(said, dict):
        return
    given = [name for name, value in said.items() if value is not None]
    for one, other in SAME:
        if one in given and other in given:
            yield (
                ("camera", one),
                f"{one} and {other} say the same in two ways; a camera has one of them. Take one out, or, "
                f"where it comes from a file that this one rests on, write `{other}:` with nothing after it.",
            )
