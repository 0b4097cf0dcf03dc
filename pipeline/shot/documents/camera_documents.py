"""The entries `camera` and `shutter` of a shot file. Angles are degrees there, lenses in millimetres."""

import math
from typing import Annotated, Any, Self

from pydantic import Field, ValidationInfo, field_validator, model_validator

from flowsculpt.pipeline.flow.keyframes import keyed
from flowsculpt.pipeline.flow.parameters import Number, VectorParameter, vector_at
from flowsculpt.pipeline.shot.camera_path import EYE_DISTANCE, FULL_FRAME, CameraMove, CameraPath, Shutter
from flowsculpt.pipeline.shot.documents.curves import (
    ABOVE_0,
    ANYWHERE,
    CURVE,
    CURVE_FORM,
    Bounds,
    Ease,
    FromSound,
    FromSoundTriple,
    KeyDocument,
    Keyed,
    NumberField,
    OverTime,
    OverTimeTriple,
    PlaceField,
    PositiveField,
    curve_form,
    number,
    place,
    sampled_frames,
    within,
)
from flowsculpt.pipeline.shot.documents.field_types import (
    DEGREE,
    ByForm,
    Document,
    Positive,
    Real,
    Triple,
    ZeroToOne,
    is_number,
    is_written_number,
    one_of,
    optional,
)
from flowsculpt.pipeline.shot.motion import Clock
from flowsculpt.pipeline.shot.yaml.document_validation import finding
from flowsculpt.render.scene.render_camera import KINDS, Projection

SAFE_AREAS = {"action": 0.035, "title": 0.05}
"""Margins by name: the fractions at each side outside the safe areas of SMPTE ST 2046-1."""

FIELD_OF_VIEW, ELEVATION = 26.0, 14.0
"""Defaults of a perspective, degrees."""

WIDE_FIELD_OF_VIEW, DOME_FIELD_OF_VIEW = 75.0, 50.0
"""Defaults of wide projections, degrees: a sculpture that one looks around in, without turning the head."""

DOME_ELEVATION = 35.0
"""Default elevation of a dome's target above its springline, degrees: within the 20° to 45° at ease."""

FieldOfView = Annotated[Positive, Field(lt=180)]
FieldOfViewField = Annotated[
    FieldOfView | Keyed[FieldOfView] | OverTime | FromSound,
    CURVE,
    within(Bounds(math.ulp(0.0), math.nextafter(180.0, 0.0), "above 0 and below 180")),
]

SafeArea = Annotated[str, one_of(SAFE_AREAS, "safe area")]
Margin = Annotated[float, Field(ge=0, lt=0.5)]
MarginField = Annotated[
    Margin | Keyed[Margin] | OverTime | FromSound | SafeArea,
    ByForm(lambda value: 4 if isinstance(value, str) and not is_written_number(value) else curve_form(value)),
    within(Bounds(0.0, math.nextafter(0.5, 0.0), "at 0 or above and below 0.5")),
]


def _focus_form(value: Any) -> int:
    """Return which member of `FocusField` a focus is: a distance, a place or a word."""
    if isinstance(value, str) and not is_written_number(value):
        return 8
    kind = curve_form(value)
    if kind == 1 and isinstance(value.get("keys"), dict):
        first = next(iter(value["keys"].values()), None)
        value = first.get("value") if isinstance(first, dict) else first
    elif kind == 2:
        value = value["formula"]
    elif kind == 3:
        value = value.get("gain")
    return 2 * kind + isinstance(value, list)


FOCUS_WORDS = ("subject", "front")
"""What focus may be besides numbers and the names of subjects."""

FocusField = Annotated[
    Positive
    | Triple
    | Annotated[Keyed[Positive], within(ABOVE_0)]
    | Annotated[Keyed[Triple], within(ANYWHERE)]
    | Annotated[OverTime, within(ABOVE_0)]
    | Annotated[OverTimeTriple, within(ANYWHERE)]
    | Annotated[FromSound, within(ABOVE_0)]
    | Annotated[FromSoundTriple, within(ANYWHERE)]
    | str,
    ByForm(_focus_form),
]


MOVES = {"push": 0.15, "arc": 30.0, "crane": 12.0, "reveal": 0.4, "handheld": 0.25}
"""Moves of a camera, and how far each goes where a shot only names it."""


class CameraMoveDocument(Document):
    """Moves of the camera, made together. `{push: , arc: 40}`: a name alone takes its default."""

    example = "{push: 0.15}"

    push: Annotated[float, Field(gt=-1, lt=1)] | None = optional(
        "share of the distance by which it comes nearer, 0.15 by default; negative goes away"
    )
    arc: Annotated[float, Field(ge=-360, le=360)] | None = optional(
        "goes around the set, by 30 by default; positive to the right (degrees)"
    )
    crane: Annotated[float, Field(ge=-90, le=90)] | None = optional("rises, by 12 by default (degrees)")
    reveal: Annotated[float, Field(gt=0, lt=1)] | None = optional(
        "begins nearer by this share of the distance, 0.4 by default, and shows the whole at the end"
    )
    track: Annotated[list[str], Field(min_length=2, max_length=9)] | None = optional(
        "names of subjects at which it looks, one after another"
    )
    handheld: Annotated[float, Field(ge=0, le=2)] | None = optional(
        "greatest sway, 0.25 by default (% of the picture's width)"
    )
    seed: Annotated[int, Field(ge=0, le=2**31)] = Field(0, description="another one sways differently")
    ease: Ease = Field("sine_in_out", description="from its beginning to its end")
    begin: Real | None = optional("frame in which it begins; by default the first", alias="from")
    end: Real | None = optional("frame in which it ends; by default the last", alias="to")

    @model_validator(mode="before")
    @classmethod
    def _by_default(cls, value: Any) -> Any:
        """Give moves that are only named their defaults."""
        if not isinstance(value, dict):
            return value
        return {name: MOVES.get(name) if each is None else each for name, each in value.items()}

    @model_validator(mode="after")
    def _moves_forwards(self, info: ValidationInfo) -> Self:
        """Check that something moves, and that it ends after it begins."""
        if self.track is None and all(getattr(self, name) is None for name in MOVES):
            raise ValueError("nothing moves. Write push, arc, crane, reveal, track or handheld.")
        clock: Clock | None = (info.context or {}).get("clock")
        if clock is not None:
            begin, end = self._frames(clock)
            if not begin < end:
                raise ValueError(
                    f"the move ends at frame {end:g}, and begins at {begin:g}. Write a later to."
                )
        return self

    def _frames(self, clock: Clock) -> tuple[float, float]:
        frames = clock.frames
        begin, end = self.begin, self.end
        return frames.first if begin is None else begin, frames.last if end is None else end

    def build(self, clock: Clock) -> CameraMove:
        times = tuple(clock.time(frame) for frame in self._frames(clock))
        units = {"arc": DEGREE, "crane": DEGREE, "handheld": 0.01}
        given = {name: getattr(self, name) for name in MOVES if getattr(self, name) is not None}
        amounts = {name: float(value) * units.get(name, 1.0) for name, value in given.items()}
        track = tuple(self.track or ())
        return CameraMove(keyed(times, (0.0, 1.0), self.ease), track=track, seed=self.seed, **amounts)


class CameraDocument(Document):
    """The camera. An empty value counts as left out, so that a shot can undo a value that it inherits."""

    example = "{azimuth: 20}"

    azimuth: NumberField | None = Field(
        default=-30.0,
        description="0 looks from the front, positive from the right; the set turns along (degrees)",
    )
    elevation: NumberField | None = Field(
        default=ELEVATION, description="above the horizon; by default 0 for wide projections (degrees)"
    )
    orbit: NumberField | None = optional("speed of the camera around the set, which stands still (degrees/s)")
    projection: Annotated[str, one_of(KINDS, "projection")] = Field(
        default="perspective",
        description="perspective; for headsets and domes spherical (all around), vr180 (stereo) or dome",
    )
    dome_angle: Annotated[Positive, Field(le=360)] | None = optional(
        "full angle of a dome's circle; 180 by default (degrees)"
    )
    dome_elevation: Annotated[float, Field(ge=0, le=90)] | None = optional(
        "of the target above the springline of a dome, in front; 90 is the zenith, 35 the default (degrees)"
    )
    eye_distance: Positive | None = optional("between the eyes of vr180; 64 by default (mm)")
    field_of_view: FieldOfViewField | None = Field(
        default=FIELD_OF_VIEW,
        description="across the longer side of the picture; of wide projections, what the sculpture fills, "
        "by default 75, in a dome 50 (degrees)",
    )
    focal_length: PositiveField | None = optional("of the lens, in place of the field of view (mm)")
    sensor_width: Positive = Field(
        default=FULL_FRAME, description="of the longer side of the sensor; full frame by default (mm)"
    )
    margin: MarginField = Field(
        default=0.1, description="fraction of the picture left empty on each side; action; title"
    )
    follow: ZeroToOne = Field(default=1.0, description="1 follows the sculpture, 0 stands still")
    dolly: PositiveField | None = optional("factor on the distance that framing finds: below 1 is closer")
    distance: PositiveField | None = optional(
        "from the target, in place of the one that framing finds (units)"
    )
    target: PlaceField | None = optional(
        "what the camera looks at, in place of the sculpture's middle (units)"
    )
    position: PlaceField | None = optional("of the camera, in place of all that framing finds (units)")
    move: CameraMoveDocument | None = optional("a move of the camera around what framing finds")
    roll: NumberField = Field(
        default=0.0, description="about the lens, clockwise as the camera looks (degrees)"
    )
    aperture: PositiveField | None = optional(
        "f-number: the smaller, the more is out of focus; without it everything is sharp"
    )
    focus: FocusField | None = optional(
        "what is sharp: subject, its nearest point (front), that of one of several subjects by its name, a "
        "distance from the lens, or a place (units)"
    )
    unit: Positive | None = optional(
        "length of a scene unit; by default a sculpture is about 200 mm large, in vr180 2 m (mm)"
    )

    @field_validator("move")
    @classmethod
    def _is_framed(cls, move: Any, info: ValidationInfo) -> Any:
        """Check that no position holds the camera."""
        if move is not None and info.data.get("position") is not None:
            raise ValueError("position holds the camera, so it cannot move. Leave one of them out.")
        if move is not None and move.track is not None and info.data.get("target") is not None:
            raise ValueError("target is what the camera looks at, so it cannot track. Leave one of them out.")
        return move

    @field_validator("position")
    @classmethod
    def _looks_somewhere(cls, position: Any, info: ValidationInfo) -> Any:
        """Check that the camera never stands at its own target."""
        clock: Clock | None = (info.context or {}).get("clock")
        target = info.data.get("target")
        if clock is None or position is None or target is None or not _has_times(clock, position, target):
            return position
        camera, aim = place(position, clock), place(target, clock)
        for frame in sampled_frames(clock):
            start, end = (vector_at(point, clock.time(frame)) for point in (camera, aim))
            if math.dist(start, end) <= 1e-9 * max(1.0, math.hypot(*start)):
                raise finding(
                    f"at frame {frame:g} the camera stands at its own target, {list(start)}; it has no "
                    "direction. Move one of them."
                )
        return position

    def build(self, clock: Clock) -> CameraPath:
        wide, is_dome = self.projection != "perspective", self.projection == "dome"
        elevation = self._given("elevation", 0.0 if wide else ELEVATION)
        filled = DOME_FIELD_OF_VIEW if is_dome else WIDE_FIELD_OF_VIEW if wide else FIELD_OF_VIEW
        field_of_view = self._given("field_of_view", filled)
        angle = 180.0 if self.dome_angle is None else self.dome_angle
        height = DOME_ELEVATION if self.dome_elevation is None else self.dome_elevation
        return CameraPath(
            projection=Projection(self.projection, math.radians(angle)),
            eye_distance=EYE_DISTANCE if self.eye_distance is None else float(self.eye_distance),
            lift=math.radians(90.0 - height) if is_dome else 0.0,
            azimuth=number(-30.0 if self.azimuth is None else self.azimuth, clock, DEGREE),
            elevation=number(elevation, clock, DEGREE),
            field_of_view=number(field_of_view, clock, DEGREE),
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
            move=None if self.move is None else self.move.build(clock),
        )

    def _given(self, name: str, default: float) -> Any:
        """Return a value of the shot file, or a default where it is empty or left out."""
        value = getattr(self, name)
        return default if value is None or name not in self.model_fields_set else value


def _number(value: float | Keyed[Any] | OverTime | FromSound | None, clock: Clock) -> Number | None:
    return None if value is None else number(value, clock)


def _focus(value: Any, clock: Clock) -> Number | VectorParameter | str | None:
    if value is None or isinstance(value, str):
        return None if value == "subject" else value
    first = next(iter(value.keys.values())) if isinstance(value, Keyed) else value
    first = first.value if isinstance(first, KeyDocument) else first
    is_place = isinstance(first, list | OverTimeTriple | FromSoundTriple)
    return place(value, clock) if is_place else number(value, clock)


def _has_times(clock: Clock, *values: Any) -> bool:
    """Tell whether all keys are times; `motion_checks.check_keys` reports those that are none."""
    return all(None not in map(clock.seconds, value.keys) for value in values if isinstance(value, Keyed))


Opening = Annotated[float, Field(ge=0, le=360)]
OpeningField = Annotated[
    Opening | Keyed[Opening] | OverTime | FromSound,
    CURVE,
    within(Bounds(-1e-9, 360.0 + 1e-9, "from 0 to 360")),
    CURVE_FORM,
]
Phase = Annotated[float, Field(ge=-360, le=0)]
PhaseField = Annotated[
    Phase | Keyed[Phase] | OverTime | FromSound,
    CURVE,
    within(Bounds(-360.0 - 1e-9, 1e-9, "from -360 to 0")),
    CURVE_FORM,
]


class ShutterDocument(Document):
    example = "{angle: 180}"

    @model_validator(mode="before")
    @classmethod
    def _is_a_mapping(cls, value: Any) -> Any:
        """Refuse the share of a frame that other programs have, with the angle that it is."""
        if is_number(value) and 0 < value <= 1:
            raise finding(
                f"shutter is {value}; it must be a mapping, with an angle for the share of a frame. "
                f"Write shutter: {{angle: {360 * value:g}}}."
            )
        return value

    angle: OpeningField = Field(
        default=180.0, description="opening of the shutter; 360 is a whole frame, 0 no blur (degrees)"
    )
    phase: PhaseField | None = optional(
        "when it opens, before the frame; by default half the angle (degrees)"
    )

    def build(self, clock: Clock) -> Shutter:
        phase = None if self.phase is None else number(self.phase, clock, DEGREE)
        return Shutter(number(self.angle, clock, DEGREE), phase)
