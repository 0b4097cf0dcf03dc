"""What a shot file says under `lights` and `stage`, and what it becomes."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping
from typing import Annotated, Any

from pydantic import AfterValidator, Discriminator, Field, PrivateAttr, Tag, ValidationInfo, model_validator

from pipeline.errors import suggestion
from pipeline.shot.checks.file_checks import Problem
from pipeline.shot.documents.fields import DEGREE, Colour, Document, Positive, Triple, one_of, vector
from pipeline.shot.yaml.parse_context import Surroundings, finding
from pipeline.shot.yaml.source import Source
from render.base.errors import RenderError
from render.scene.daylight import Daylight, sun_position
from render.scene.environment import Environment, read_map
from render.scene.lights import LIGHTS, LightRig, Sky, Softbox
from render.scene.stage import STAGES, Stage

MIDDLE = [0.0, 1.0, 0.0]
Degrees = Annotated[float, Field(ge=-3600, le=3600)]
Strength = Annotated[float, Field(ge=0, le=1e6)]
Light = Annotated[
    Annotated[Strength, Tag("plain")]
    | Annotated[Annotated[list[Strength], Field(min_length=3, max_length=3)], Tag("list")],
    Discriminator(lambda value: "list" if isinstance(value, list) else "plain"),
]
Strengths = Annotated[
    Annotated[Strength, Tag("of all")] | Annotated[dict[str, Strength], Tag("by name")],
    Discriminator(lambda value: "by name" if isinstance(value, dict) else "of all"),
]
AROUND = ("sun", "sky", "hdri")
"""What shines from all sides, of which there is one."""


def _readable(name: str, info: ValidationInfo) -> str:
    """A file that holds a map of light; its digest is noted."""
    around = Surroundings.of(info)
    path = around.file(name)
    try:
        read_map(str(path), around.digests[path])
    except RenderError as error:
        raise finding(str(error)) from None
    return name


Map = Annotated[str, AfterValidator(_readable)]


class SoftboxDocument(Document):
    """See `Softbox`."""

    position: Triple
    width: Positive = 1.6
    height: Positive = 1.6
    radiance: Light
    target: Triple = MIDDLE

    @model_validator(mode="after")
    def _faces_somewhere(self) -> SoftboxDocument:
        if math.dist(self.position, self.target) < 1e-6:
            raise finding("a softbox stands at its own target, so it faces nowhere. Move one of them.")
        return self

    def build(self) -> Softbox:
        return Softbox(
            vector(self.position),
            float(self.width),
            float(self.height),
            _light(self.radiance),
            vector(self.target),
        )


class SkyDocument(Document):
    """See `Sky`."""

    zenith: Light
    horizon: Light | None = None
    nadir: Light | None = None
    visible: bool = False

    def build(self) -> Sky:
        zenith = _light(self.zenith)
        horizon = zenith if self.horizon is None else _light(self.horizon)
        return Sky(zenith, horizon, horizon if self.nadir is None else _light(self.nadir), self.visible)


class SunDocument(Document):
    """A clear day; angles in degrees. See `Daylight`."""

    time: Annotated[float, Field(ge=0, le=24)] | None = None
    latitude: Annotated[float, Field(ge=-90, le=90)] | None = None
    day: Annotated[int, Field(ge=1, le=366)] | None = None
    north: Degrees | None = None
    elevation: Annotated[float, Field(gt=0, le=90)] | None = None
    azimuth: Degrees | None = None
    turbidity: Annotated[float, Field(ge=1, le=10)] = 3.0
    width: Annotated[float, Field(ge=0.1, le=20)] | None = None
    visible: bool = True

    @model_validator(mode="after")
    def _stands_somewhere(self) -> SunDocument:
        by_time, by_angle = ("latitude", "day", "north"), ("elevation", "azimuth")
        others = by_time if self.time is None else by_angle
        strangers = [name for name in others if getattr(self, name) is not None]
        if strangers:
            raise finding(
                f"sun has {strangers[0]} {'without' if self.time is None else 'beside'} time; its place is "
                "told by time, latitude, day and north, or by elevation and azimuth. Write one of the two."
            )
        if self.time is not None and (height := self._stands()[0]) <= 0.0:
            raise finding(
                f"sun is {-height / DEGREE:.1f}° below the horizon at {self.time:g} h on day {self._day} at "
                f"latitude {self._latitude:g}°; it must be above. {self._remedy()}"
            )
        return self

    @property
    def _day(self) -> int:
        return 172 if self.day is None else self.day

    @property
    def _latitude(self) -> float:
        return 48.0 if self.latitude is None else self.latitude

    def _stands(self) -> tuple[float, float]:
        """Elevation, and azimuth as cameras have it, radians."""
        assert self.time is not None
        elevation, clockwise = sun_position(self.time, self._latitude * DEGREE, self._day)
        north = 180.0 if self.north is None else self.north
        return elevation, north * DEGREE - clockwise

    def _remedy(self) -> str:
        hours = [hour / 4 for hour in range(97)]
        up = [t for t in hours if sun_position(t, self._latitude * DEGREE, self._day)[0] > 0.0]
        if not up:
            return "It does not rise on that day; take another, or another latitude."
        return f"Write a time from {up[0]:g} to {up[-1]:g}."

    def build(self) -> Daylight:
        plain = Daylight()
        if self.time is not None:
            elevation, azimuth = self._stands()
        else:
            elevation = plain.elevation if self.elevation is None else self.elevation * DEGREE
            azimuth = plain.azimuth if self.azimuth is None else self.azimuth * DEGREE
        width = plain.width if self.width is None else self.width * DEGREE
        return Daylight(elevation, azimuth, float(self.turbidity), width, visible=self.visible)


class LightsDocument(Document):
    """A rig of the registry, lamps of one's own, and what shines from all around. Angles in degrees."""

    rig: Annotated[str, one_of(LIGHTS, "light rig")] | None = None
    softboxes: Annotated[list[SoftboxDocument], Field(min_length=1, max_length=64)] | None = None
    sky: SkyDocument | None = None
    sun: SunDocument | None = None
    hdri: Map | None = None
    visible: bool = True
    turn: Degrees = 0.0
    intensity: Strengths = 1.0
    exposure: Annotated[float, Field(ge=-20, le=20)] = 0.0

    _environment: Environment | None = PrivateAttr(None)

    @model_validator(mode="after")
    def _agrees(self, info: ValidationInfo) -> LightsDocument:
        around = [name for name in AROUND if getattr(self, name) is not None]
        if len(around) > 1:
            raise finding(
                f"lights has both {around[0]} and {around[1]}; light from all around is one of sky, sun and "
                "hdri. Remove one of them."
            )
        if self.hdri is not None:
            path = Surroundings.of(info).folder / self.hdri
            digest = Surroundings.of(info).digests[path]
            self._environment = Environment(digest, visible=self.visible, path=str(path))
        elif "visible" in self.model_fields_set:
            raise finding(
                "lights has visible, which is for hdri; sun and sky have their own. Move or remove it."
            )
        return self

    def build(self) -> LightRig:
        rig = self._plain()
        strengths = self.intensity
        if not isinstance(strengths, dict):
            strengths = dict.fromkeys((*rig.names, ""), float(strengths))
        return dataclasses.replace(
            rig.dimmed(strengths).turned(self.turn * DEGREE), exposure=float(self.exposure)
        )

    def _plain(self) -> LightRig:
        """Before it is turned and dimmed. What is written out stands alone, unless a rig is named too."""
        own = self.softboxes or [getattr(self, name) for name in AROUND if getattr(self, name) is not None]
        rig = LIGHTS[self.rig] if self.rig else LightRig() if own else LIGHTS["studio"]
        boxes = tuple(box.build() for box in self.softboxes or ())
        rig = dataclasses.replace(rig, softboxes=rig.softboxes + boxes)
        if self.sky is not None:
            rig = dataclasses.replace(rig, sky=self.sky.build(), daylight=None)
        if self.sun is not None:
            rig = dataclasses.replace(rig, daylight=self.sun.build())
        if self._environment is not None:
            rig = dataclasses.replace(rig, environment=self._environment, daylight=None)
        return rig


class StageDocument(Document):
    """A stage of the registry with some of its values replaced."""

    kind: Annotated[str, one_of(STAGES, "stage")] = "cyclorama"
    colour: Colour | None = None
    roughness: Annotated[float, Field(ge=0, le=1)] | None = None
    width: Annotated[float, Field(ge=0.2, le=10)] | None = None
    height: Annotated[float, Field(ge=0.2, le=10)] | None = None
    round: bool | None = None

    @model_validator(mode="after")
    def _has_what_it_says(self) -> StageDocument:
        heeded = {"plinth": ("colour", "roughness", "width", "height", "round"), "none": ()}
        for name in ("colour", "roughness", "width", "height", "round"):
            if getattr(self, name) is not None and name not in heeded.get(self.kind, ("colour", "roughness")):
                fitting = " or ".join(
                    kind for kind in STAGES if name in heeded.get(kind, ("colour", "roughness"))
                )
                raise finding(
                    f"stage has {name}, which {self.kind} does not heed. Remove it, or take {fitting}."
                )
        return self

    def build(self) -> Stage:
        given: dict[str, Any] = self.model_dump(exclude_none=True, exclude={"kind", "colour"})
        if self.colour:
            given["colour"] = vector(self.colour)
        return dataclasses.replace(STAGES[self.kind], **given)


def lights_of(said: str | LightsDocument) -> LightRig:
    """By name, or spelt out."""
    return LIGHTS[said] if isinstance(said, str) else said.build()


def stage_of(said: str | StageDocument) -> Stage:
    """By name, or spelt out."""
    return STAGES[said] if isinstance(said, str) else said.build()


def dimmed(source: Source) -> Iterator[Problem]:
    """The lights whose intensity is set are there."""
    said, strengths = source.get("lights"), source.get("lights", "intensity")
    if not (isinstance(said, dict) and isinstance(strengths, dict)):
        return
    names = _names(said)
    for name in strengths if names else ():
        if name not in names:
            yield ("lights", "intensity", name), f"{name} is no light here. {suggestion(str(name), names)}"


def _names(said: Mapping[str, Any]) -> tuple[str, ...]:
    """Of all that `intensity` can dim; none where that cannot be told."""
    own = any(said.get(name) is not None for name in ("softboxes", *AROUND))
    rig = said.get("rig") or (None if own else "studio")
    if rig is None:
        return ("sun", "sky") if said.get("sun") is not None else ("sky",)
    if rig not in LIGHTS:
        return ()
    names = LIGHTS[rig].names
    return (*names, "sun") if said.get("sun") is not None and "sun" not in names else names


def _light(value: float | list[float]) -> tuple[float, float, float]:
    return vector(value) if isinstance(value, list) else (float(value), float(value), float(value))
