"""The entries `lights` and `stage` of a shot file, and the light rig and the stage that they become."""

import dataclasses
import math
import re
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import AfterValidator, BeforeValidator, Field, PrivateAttr, ValidationInfo, model_validator

from flowsculpt.pipeline.errors import quote
from flowsculpt.pipeline.shot.documents.field_types import (
    DEGREE,
    HEX_PATTERN,
    MAPPING_IS_SECOND,
    ByForm,
    Colour,
    Degrees,
    Document,
    Positive,
    SchemaKeywords,
    Triple,
    ZeroToOne,
    is_written_number,
    one_of,
    optional,
    parsed_colour,
    vector,
)
from flowsculpt.pipeline.shot.yaml.document_validation import ParseContext, finding
from flowsculpt.pipeline.shot.yaml.yaml_source import in_yaml
from flowsculpt.render.scene.scene_lights import LIGHTS, LightRig, Sky, Softbox
from flowsculpt.render.scene.scene_stage import STAGES, Stage
from flowsculpt.render.scene.sky import Daylight, Environment, environment_of, sun_position
from flowsculpt.render.scene.surface_detail import FINISHES


class StageDocument(Document):
    """A stage of the registry with some of its settings replaced."""

    example = "{kind: ground}"

    kind: Annotated[str, one_of(STAGES, "stage")] = Field("cyclorama", description="its name")
    colour: Colour | None = optional(
        "of floor and wall: red, green, blue from 0 to 1, linear Rec.709, or '#c04020'"
    )
    roughness: ZeroToOne | None = optional(
        "of a coat on the floor: 0.05 mirrors, 0.4 shimmers; by default matt"
    )
    width: Annotated[float, Field(ge=0.2, le=10)] | None = optional(
        "of plinth or table, or between uprights of the shelf, in half-sizes of the subject; by default 1.7"
    )
    height: Annotated[float, Field(ge=0.2, le=10)] | None = optional(
        "of plinth, table or walls, or between boards of the shelf, in half-sizes; by default 1.6"
    )
    round: bool | None = optional("a round plinth or table instead of a square one")
    plinth_colour: Colour | None = optional("of plinth, shelf or table; by default a light grey")
    plinth_roughness: ZeroToOne | None = optional("of a coat on it; by default matt")
    wall_colour: Colour | None = optional("of flat walls, or what the floor's changes to at a round rim")
    halo_colour: Colour | None = optional("of a soft spot behind the subject, on floor and wall")
    halo_size: Annotated[float, Field(ge=0.5, le=20)] | None = optional(
        "from the middle of the spot to where half of its colour is left, in half-sizes; by default 3"
    )
    halo_distance: Annotated[float, Field(ge=0, le=20)] | None = optional(
        "of the spot behind the subject, in half-sizes; by default 6, for low cameras 12"
    )
    horizon_fade: Annotated[float, Field(ge=0.2, le=20)] | None = optional(
        "of ground: height of the haze in which the horizon melts into the sky; by default none (degrees)"
    )
    finish: Annotated[str, one_of(FINISHES, "finish")] | None = optional(
        f"of floor and wall: {', '.join(FINISHES)}; by default an even one"
    )
    plinth_finish: Annotated[str, one_of(FINISHES, "finish")] | None = optional("of what subjects stand on")
    shadow_catcher: bool | None = optional(
        "floor and wall are not seen, but the shadows on them, as alpha: for compositing"
    )

    @model_validator(mode="after")
    def _kind_has_all(self) -> Self:
        halo = ("halo_size", "halo_distance")
        wall = ("colour", "roughness", "shadow_catcher", "finish", "wall_colour", "halo_colour", *halo)
        stands = ("width", "height", "plinth_colour", "plinth_roughness", "plinth_finish")
        plinth, room = (*wall, *stands, "round"), wall[:5]
        ground = (*wall[:4], "horizon_fade")
        settings = dict.fromkeys(STAGES, wall) | {"ground": ground, "plinth": plinth, "none": ()}
        settings |= {"table": plinth, "stair": (*wall, *stands), "shelf": (*room, *stands)}
        settings |= {"corner": (*room, "height"), "window": (*room, "plinth_colour")}
        for name in dict.fromkeys((*plinth, "horizon_fade")):
            if getattr(self, name) is not None and name not in settings[self.kind]:
                fitting = " or ".join(kind for kind in STAGES if name in settings[kind])
                raise finding(
                    f"stage has {name}, which {self.kind} does not use. Remove it, or take {fitting}."
                )
        if self.horizon_fade and self.shadow_catcher:
            raise finding("stage has horizon_fade, and a shadow catcher, which is not seen. Remove one.")
        for name in halo:
            if getattr(self, name) is not None and self.halo_colour is None:
                raise finding(f"stage has {name} without halo_colour. Write both, or remove it.")
        return self

    def build(self) -> Stage:
        given: dict[str, Any] = self.model_dump(exclude_none=True, exclude={"kind"})
        if self.horizon_fade is not None:
            given["horizon_fade"] = math.radians(self.horizon_fade)
        given |= {name: vector(value) for name, value in given.items() if name.endswith("colour")}
        return dataclasses.replace(STAGES[self.kind], **given)


SUBJECT_MIDDLE = [0.0, 1.0, 0.0]
Intensity = Annotated[float, Field(ge=0, le=1e6)]
RadianceColour = Annotated[
    list[Intensity],
    Field(min_length=3, max_length=3),
    BeforeValidator(lambda value: parsed_colour(value) if isinstance(value, str) else value),
    SchemaKeywords(type=["array", "string"], pattern=HEX_PATTERN),
]
Radiance = Annotated[
    Intensity | RadianceColour,
    ByForm(lambda value: isinstance(value, list | str) and not is_written_number(value)),
]
Intensities = Annotated[Intensity | dict[str, Radiance], MAPPING_IS_SECOND]
ENVIRONMENTS = ("sun", "sky", "hdri")
"""Lights from all directions; a shot has one of them."""


def _check_map(name: str, info: ValidationInfo) -> str:
    """Check that a file holds an environment map, and note its digest."""
    context = ParseContext.of(info)
    path = context.file(name)
    context.attempt(lambda: environment_of(str(path), context.digests[path]))
    return name


EnvironmentMap = Annotated[str, AfterValidator(_check_map)]


def _check_light_name(name: str) -> str:
    if re.fullmatch(LIGHT_NAME, name):
        return name
    meant = re.sub(r"\W+", "_", name).lstrip("_0123456789").rstrip("_")
    raise ValueError(
        f"{quote(name)} is not a name of a light or group: letters, digits and _ after a first letter. "
        f"Write {meant or 'key'}."
    )


LIGHT_NAME = r"[A-Za-z][A-Za-z0-9_]*"
LightName = Annotated[str, AfterValidator(_check_light_name), SchemaKeywords(pattern=f"^{LIGHT_NAME}$")]


def _require_groups(value: Any) -> Any:
    """Refuse what is no group, with one that is meant; a group of one light may be its name."""
    if isinstance(value, dict):
        return {name: [lights] if isinstance(lights, str) else lights for name, lights in value.items()}
    if isinstance(value, list):
        raise ValueError(f"a light group has a name. Write {{NAME: {in_yaml(value)}}}, or each.")
    if value not in ("off", "each"):
        raise ValueError(f"{quote(value)} is not a light group. Write each, off, or {{NAME: [key, rim]}}.")
    return value


LightGroupsField = Annotated[
    Literal["off", "each"]
    | dict[LightName, Annotated[list[str], Field(min_length=1), SchemaKeywords(type=["array", "string"])]],
    MAPPING_IS_SECOND,
    BeforeValidator(_require_groups),
]
"""`each`, or `{warm: [key, rim]}`."""


def softbox_name(written: str | None, number: int) -> str:
    """Return the name of a softbox that a shot writes out, which is its number-th from 1."""
    return written or f"softbox{number}"


class SoftboxDocument(Document):
    position: Triple = Field(description="right, up, towards the camera; the subject has a half-size of 1")
    width: Positive = Field(1.6, description="in half-sizes of the subject")
    height: Positive = Field(1.6, description="in half-sizes of the subject")
    radiance: Radiance = Field(description="linear Rec.709 or a number: 20 if large, 150 if small")
    target: Triple = Field(SUBJECT_MIDDLE, description="point it faces; [0, 1, 0] is the subject's middle")
    name: LightName | None = optional("for intensity and light groups; by default softbox1 and so on")
    visible: bool = Field(False, description="true if the camera sees it itself; reflections always show it")

    @model_validator(mode="after")
    def _faces_somewhere(self) -> Self:
        if math.dist(self.position, self.target) < 1e-6:
            raise finding("a softbox stands at its own target, so it has no direction. Move one of them.")
        return self

    def build(self, number: int) -> Softbox:
        return Softbox(
            vector(self.position),
            float(self.width),
            float(self.height),
            _radiance(self.radiance),
            vector(self.target),
            softbox_name(self.name, number),
            self.visible,
        )


class SkyDocument(Document):
    example = "{zenith: 0.3}"

    zenith: Radiance = Field(description="radiance from above, linear Rec.709 or a number")
    horizon: Radiance | None = optional("radiance from the horizon; by default as from above")
    nadir: Radiance | None = optional("radiance from below; by default as from the horizon")
    visible: bool = Field(False, description="true if the camera sees it where the stage leaves it")

    def build(self) -> Sky:
        zenith = _radiance(self.zenith)
        horizon = zenith if self.horizon is None else _radiance(self.horizon)
        return Sky(zenith, horizon, horizon if self.nadir is None else _radiance(self.nadir), self.visible)


def _hours(value: Any) -> Any:
    """Refuse a time of day with minutes, with the hours that it means."""
    if isinstance(value, str) and (match := re.fullmatch(r"(\d{1,2}):([0-5]\d)(?::\d\d)?", value)):
        hours = int(match[1]) + int(match[2]) / 60
        raise ValueError(f"{quote(value)} is not a number of hours. Write {hours:.4g}.")
    return value


class SunDocument(Document):
    """Sun and sky of a clear day."""

    example = "{elevation: 20}"

    time: Annotated[float, BeforeValidator(_hours), Field(ge=0, le=24)] | None = optional(
        "solar time: the sun is highest at 12 (hours)"
    )
    latitude: Annotated[float, Field(ge=-90, le=90)] | None = optional(
        "north positive; by default 48 (degrees)"
    )
    day: Annotated[int, Field(ge=1, le=366)] | None = optional(
        "of the year; by default 172, midsummer in the north"
    )
    north: Degrees | None = optional("azimuth of north; by default 180, behind the subject (degrees)")
    elevation: Annotated[float, Field(gt=0, le=90)] | None = optional(
        "above the horizon, in place of a time; by default 32 (degrees)"
    )
    azimuth: Degrees | None = optional(
        "0 shines from the front, positive from the right; by default -78 (degrees)"
    )
    turbidity: Annotated[float, Field(ge=1, le=10)] = Field(3.0, description="haze, from 1 to 10")
    width: Annotated[float, Field(ge=0.1, le=20)] | None = optional(
        "of its disc, by default 0.54; larger ones have softer shadows (degrees)"
    )
    visible: bool = Field(True, description="true if the camera sees the sky where the stage leaves it")

    @model_validator(mode="after")
    def _has_one_position(self) -> Self:
        by_time, by_angle = ("latitude", "day", "north"), ("elevation", "azimuth")
        unused = by_time if self.time is None else by_angle
        others_given = [name for name in unused if getattr(self, name) is not None]
        if others_given:
            raise finding(
                f"sun has {others_given[0]} {'without' if self.time is None else 'beside'} time; it stands "
                "by time, latitude, day and north, or by elevation and azimuth. Write one of the two."
            )
        if self.time is not None and (height := self._position()[0]) <= 0.0:
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

    def _position(self) -> tuple[float, float]:
        """Return elevation and azimuth, radians; azimuth as cameras have it."""
        assert self.time is not None
        elevation, clockwise = sun_position(self.time, self._latitude * DEGREE, self._day)
        north = 180.0 if self.north is None else self.north
        return elevation, north * DEGREE - clockwise

    def _remedy(self) -> str:
        hours = [hour / 4 for hour in range(97)]
        day = [t for t in hours if sun_position(t, self._latitude * DEGREE, self._day)[0] > 0.0]
        if not day:
            return "It does not rise on that day; take another, or another latitude."
        return f"Write a time from {day[0]:g} to {day[-1]:g}."

    def build(self) -> Daylight:
        angles = {name: getattr(self, name) for name in ("elevation", "azimuth", "width")}
        given = {name: angle * DEGREE for name, angle in angles.items() if angle is not None}
        if self.time is not None:
            given["elevation"], given["azimuth"] = self._position()
        return Daylight(turbidity=float(self.turbidity), visible=self.visible, **given)


class LightsDocument(Document):
    """A light rig of the registry, softboxes, and one light from all directions."""

    example = "{rig: studio}"
    names_within: ClassVar = {name: "intensity" for rig in LIGHTS.values() for name in rig.names}
    """Names of single lights, and the setting that each is a name of."""

    rig: Annotated[str, one_of(LIGHTS, "light rig")] | None = optional(
        "lights by name; studio if no lights are written out"
    )
    softboxes: Annotated[list[SoftboxDocument], Field(min_length=1, max_length=64)] | None = optional(
        "area lights, alone or beside those of a rig"
    )
    sky: SkyDocument | None = optional("a gradient of light from all directions, in place of the rig's")
    sun: SunDocument | None = optional("the sun and sky of a clear day, at rest while the camera moves")
    hdri: EnvironmentMap | None = optional(
        "an environment map beside the shot file, EXR or HDR, twice as wide as high"
    )
    visible: bool = Field(True, description="true if the camera sees the hdri where the stage leaves it")
    turn: Degrees = Field(
        0.0, description="of all lights about the vertical, anticlockwise from above (degrees)"
    )
    intensity: Intensities = Field(
        1.0, description="factor on all lights, or on each by its name: a number or a colour"
    )
    exposure: Annotated[float, Field(ge=-20, le=20)] = Field(0.0, description="brightness (stops)")

    _environment: Environment | None = PrivateAttr(None)

    @model_validator(mode="after")
    def _is_consistent(self, info: ValidationInfo) -> Self:
        given = [name for name in ENVIRONMENTS if getattr(self, name) is not None]
        if len(given) > 1:
            raise finding(
                f"lights has both {given[0]} and {given[1]}; light from all directions is one of sky, sun "
                "and hdri. Remove one of them."
            )
        if self.hdri is not None:
            context = ParseContext.of(info)
            path = context.folder / self.hdri
            found = environment_of(str(path), context.digests[path])
            self._environment = dataclasses.replace(found, visible=self.visible)
        elif "visible" in self.model_fields_set:
            raise finding(
                "lights has visible, which is for hdri; sun and sky have their own. Move or remove it."
            )
        self.build()
        return self

    def build(self) -> LightRig:
        rig = self._unscaled()
        if isinstance(self.intensity, dict):
            intensities = {
                name: vector(value) if isinstance(value, list) else float(value)
                for name, value in self.intensity.items()
            }
        else:
            intensities = dict.fromkeys(rig.names, float(self.intensity))
        return dataclasses.replace(
            rig.dimmed(intensities).turned(self.turn * DEGREE), exposure=float(self.exposure)
        )

    def _unscaled(self) -> LightRig:
        """Return the rig before turn and intensity. Written lights stand alone unless a rig is named too."""
        written = self.softboxes or any(getattr(self, name) is not None for name in ENVIRONMENTS)
        rig = LIGHTS[self.rig] if self.rig else LightRig() if written else LIGHTS["studio"]
        boxes = tuple(box.build(number) for number, box in enumerate(self.softboxes or (), 1))
        rig = dataclasses.replace(rig, softboxes=rig.softboxes + boxes)
        if self.sky is not None:
            rig = dataclasses.replace(rig, sky=self.sky.build(), daylight=None)
        if self.sun is not None:
            rig = dataclasses.replace(rig, daylight=self.sun.build())
        if self._environment is not None:
            rig = dataclasses.replace(rig, environment=self._environment, daylight=None)
        return rig


_SPELT_OUT = {
    "off": "{intensity: 0}",
    "none": "{intensity: 0}",
    "hdri": "{hdri: FILE.exr}",
    "sun": "{sun: {elevation: 40}}",
    "sky": "{sky: {zenith: 0.3}}",
}
"""Words that do not name a light rig, and the lights that they mean."""


def require_rig(value: Any) -> Any:
    """Refuse words that are no rig and mean lights that are spelt out."""
    if isinstance(value, str) and (meant := _SPELT_OUT.get(value)):
        raise ValueError(f"{quote(value)} is not a light rig. Write lights: {meant}.")
    return value


def _radiance(value: float | list[float]) -> tuple[float, float, float]:
    return vector(value) if isinstance(value, list) else (float(value), float(value), float(value))
