"""Light rigs and light groups.

A rig is in stage units: the subject has a half-size of 1 and stands on the floor y = 0. It
is built around the subject and moved with the stage (`scene_stage.StagePlacement`); softboxes have a
radiance, not a power, so a stage of any size is equally bright. Light groups are the light of some emitters
each, as layers of a frame; they sum to the beauty.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.base.serialise import OMIT_DEFAULT, Colour, Triple
from flowsculpt.render.scene import clear_sky
from flowsculpt.render.scene.render_camera import triple, unit
from flowsculpt.render.scene.rgb_spaces import LUMA
from flowsculpt.render.scene.sky import SUN_WIDTH, Daylight, Environment

Pixels = NDArray[np.float32]


@dataclass(frozen=True)
class Softbox:
    """A rectangular area light that faces its target. Reflections show it.

    position, target   stage units
    width, height      stage units; height is along the vertical
    radiance           linear Rec.709
    name               its name in the rig
    visible            True if the lens sees it too
    """

    position: Triple
    width: float
    height: float
    radiance: Colour
    target: Triple = (0.0, 1.0, 0.0)
    name: str = ""
    visible: bool = field(default=False, metadata=OMIT_DEFAULT)


@dataclass(frozen=True)
class Sun:
    """Directional light with hard shadows: the direction it shines to, and its linear Rec.709 irradiance.

    WIDTH  angular diameter of the sun in nature, radians
    """

    WIDTH: ClassVar[float] = SUN_WIDTH

    direction: Triple
    irradiance: Colour


@dataclass(frozen=True)
class Sky:
    """Light from everywhere: a gradient from zenith through horizon to nadir, linear Rec.709 radiance."""

    zenith: Colour = (0.0, 0.0, 0.0)
    horizon: Colour = (0.0, 0.0, 0.0)
    nadir: Colour = (0.0, 0.0, 0.0)
    visible: bool = False

    @property
    def is_uniform(self) -> bool:
        """True if its radiance is the same in all directions."""
        return self.zenith == self.horizon == self.nadir

    @property
    def is_black(self) -> bool:
        """True if it gives no light."""
        return not any((*self.zenith, *self.horizon, *self.nadir))

    def pixels(self) -> NDArray[np.float32]:
        """Return its radiance (64, 8, 3) as an environment map."""
        height = np.cos((np.arange(64) + 0.5) / 64 * math.pi)[:, None]
        end = np.where(height > 0.0, np.array(self.zenith), np.array(self.nadir))
        rows = np.array(self.horizon) + np.abs(height) ** 0.6 * (end - np.array(self.horizon))
        return np.ascontiguousarray(np.broadcast_to(rows[:, None, :], (64, 8, 3)), dtype=np.float32)


@dataclass(frozen=True)
class LightRig:
    """All lights of a shot.

    exposure     stops; applied when linear light becomes display values
    daylight     a sun and sky in place of `sky`, or None
    environment  an environment map in place of `sky`, or None
    groups       light groups to render, in which every light is once; none by default
    """

    softboxes: tuple[Softbox, ...] = ()
    suns: tuple[Sun, ...] = ()
    sky: Sky = Sky()
    exposure: float = 0.0
    daylight: Daylight | None = None
    environment: Environment | None = None
    groups: tuple[LightGroup, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the lights whose strength `dimmed` can change."""
        distant = ("sun", "sky") if self.daylight or self.suns else ("sky",)
        return (*dict.fromkeys(box.name for box in self.softboxes if box.name), *distant)

    @property
    def keeping_colours(self) -> tuple[str, ...]:
        """Names of the lights whose strength is one number: daylight's, and an environment map's."""
        return ("sun", "sky") if self.daylight else ("sky",) if self.environment else ()

    @property
    def shows_sky(self) -> bool:
        """True if the lens sees the sky, the daylight or the environment map."""
        return (self.daylight or self.environment or self.sky).visible

    def grouped(self, written: Mapping[str, Sequence[str]]) -> LightRig:
        """Return the rig with light groups: those written, by name, and one for each other light.

        A visible sky has two: what the lens sees of it itself, and the light that it gives.
        """
        groups = [LightGroup(name, tuple(lights)) for name, lights in written.items()]
        taken = {light for group in groups for light in group.lights}
        if self.sky.is_black and not (self.daylight or self.environment):
            taken |= {"sky", BACKGROUND}
        boxes = [replace(b, name=b.name or f"softbox{n}") for n, b in enumerate(self.softboxes, 1)]
        named = replace(self, softboxes=tuple(boxes))
        others = dict.fromkeys((*named.names, BACKGROUND) if self.shows_sky else named.names)
        alone = [LightGroup(name, (name,)) for name in others if name not in taken]
        return replace(named, groups=(*groups, *alone))

    def only(self, group: LightGroup) -> LightRig:
        """Return the rig with all lights but those of a group dark."""
        return self.dimmed({name: float(name in group.lights) for name in self.names})

    def turned(self, angle: float) -> LightRig:
        """Return the rig turned by radians about the vertical, from +z towards +x."""
        if angle == 0.0:
            return self
        return replace(
            self,
            softboxes=tuple(
                replace(box, position=_turn(box.position, angle), target=_turn(box.target, angle))
                for box in self.softboxes
            ),
            suns=tuple(replace(sun, direction=_turn(sun.direction, angle)) for sun in self.suns),
            daylight=self.daylight and replace(self.daylight, azimuth=self.daylight.azimuth + angle),
            environment=self.environment and replace(self.environment, turn=self.environment.turn + angle),
        )

    def dimmed(self, strengths: Mapping[str, float | Triple]) -> LightRig:
        """Return the rig with the strength of lights multiplied, by their names.

        A strength is a factor, or one each on red, green and blue. Raises BadInputError for the latter on
        lights that keep their colours.
        """
        sun, sky = strengths.get("sun", 1.0), strengths.get("sky", 1.0)
        for name in self.keeping_colours:
            if isinstance(strengths.get(name), tuple):
                raise BadInputError(
                    f"intensity of {name} is a colour; daylight and an hdri keep theirs. Write a number."
                )
        return replace(
            self,
            softboxes=tuple(
                replace(box, radiance=_times(box.radiance, strengths.get(box.name, 1.0)))
                for box in self.softboxes
            ),
            suns=tuple(replace(each, irradiance=_times(each.irradiance, sun)) for each in self.suns),
            sky=replace(
                self.sky,
                zenith=_times(self.sky.zenith, sky),
                horizon=_times(self.sky.horizon, sky),
                nadir=_times(self.sky.nadir, sky),
            ),
            daylight=self.daylight
            and replace(self.daylight, sun=self.daylight.sun * _one(sun), sky=self.daylight.sky * _one(sky)),
            environment=self.environment
            and replace(self.environment, intensity=self.environment.intensity * _one(sky)),
        )

    def sky_pixels(self) -> Pixels | None:
        """Return the radiance (H, W, 3) around the scene, without suns; None where it is even.

        The middle is at +z; that of an environment map is at -z, before its turn and its intensity.
        """
        if self.environment:
            return self.environment.pixels()
        if self.daylight:
            return clear_sky.sky_pixels(self.daylight)
        return None if self.sky.is_uniform else self.sky.pixels()

    def without_maps(self) -> LightRig:
        """Return a rig of softboxes, suns and a gradient sky alone, for programs that show no more."""
        if self.daylight:
            zenith, horizon = clear_sky.gradient(self.daylight)
            suns = (*self.suns, sun_of(self.daylight))
            return replace(self, suns=suns, sky=Sky(zenith, horizon), daylight=None)
        if self.environment:
            grey = _times((0.8, 0.8, 0.8), self.environment.intensity)
            return replace(self, sky=Sky(grey, grey, grey), environment=None)
        return self


def sun_of(daylight: Daylight) -> Sun:
    """Return the sun of daylight as a light of its own."""
    x, y, z = daylight.direction
    return Sun((-x, -y, -z), clear_sky.sun_irradiance(daylight))


def _turn(position: Triple, angle: float) -> Triple:
    x, y, z = position
    c, s = math.cos(angle), math.sin(angle)
    return c * x + s * z, y, c * z - s * x


def _times(colour: Colour, factor: float | Triple) -> Colour:
    red, green, blue = colour
    on_red, on_green, on_blue = factor if isinstance(factor, tuple) else (factor, factor, factor)
    return on_red * red, on_green * green, on_blue * blue


def _one(factor: float | Triple) -> float:
    """Return a factor that is a number: colours were refused."""
    return factor[0] if isinstance(factor, tuple) else factor


_FILL = (0.13, 0.155, 0.2)
"""Faint: with more, a subject would cast no contact shadow, and a mirror would show a sky like the floor."""

_KEY = Softbox((-4.4, 5.4, 4.0), 1.9, 1.9, (166.0, 145.0, 118.0), name="key")
"""Warm, from the upper left front: it models the form."""

_RIM = Softbox((4.9, 3.4, -4.4), 0.55, 2.8, (110.0, 132.0, 172.0), name="rim")
"""A cool strip behind on the right: it draws the lips of the creases."""

_BACK = Softbox((0.0, 8.6, -5.0), 4.0, 2.4, (15.0, 15.3, 16.0), target=(0.0, 0.0, -4.2), name="back")
"""High over the ground behind the subject; it separates the subject from the dark wall."""

LIGHTS = {
    "studio": LightRig((_KEY, _RIM, _BACK), sky=Sky(_FILL, _FILL, _FILL)),
    # Long strips on all sides: a mirror shows its form only by the reflections it bends.
    "gallery": LightRig(
        (
            Softbox((-5.4, 3.4, 2.6), 0.7, 5.0, (74.0, 66.0, 56.0), name="left"),
            Softbox((3.2, 3.0, 6.0), 0.35, 4.6, (40.0, 41.0, 44.0), name="front"),
            Softbox((5.2, 3.6, -3.6), 0.55, 4.4, (76.0, 90.0, 118.0), name="right"),
            Softbox((0.0, 7.6, -1.0), 5.0, 0.8, (42.0, 42.0, 42.0), name="top"),
        ),
        sky=Sky((0.30, 0.34, 0.42), (0.12, 0.13, 0.16), (0.1, 0.1, 0.1)),
    ),
    # Three-point lighting: a warm key off the axis of the lens, a faint fill opposite, a rim behind.
    "three_point": LightRig(
        (
            Softbox((5.6, 5.0, 2.6), 1.5, 1.5, (190.0, 164.0, 132.0), name="key"),
            Softbox((-5.6, 2.6, 4.4), 3.2, 2.4, (7.0, 8.0, 9.6), name="fill"),
            Softbox((-3.6, 5.4, -4.6), 0.8, 2.2, (150.0, 167.0, 196.0), name="rim"),
        ),
        sky=Sky((0.1, 0.115, 0.14), (0.1, 0.115, 0.14), (0.1, 0.115, 0.14)),
    ),
    # One window: form by a single long gradient.
    "softbox": LightRig(
        (Softbox((-4.0, 6.0, 2.8), 5.0, 5.0, (22.0, 20.9, 19.3), name="key"),),
        sky=Sky((0.2, 0.22, 0.26), (0.2, 0.22, 0.26), (0.2, 0.22, 0.26)),
    ),
    "daylight": LightRig(daylight=Daylight()),
    # A hard key from behind the side, a blue edge: pale glazed forms on dark or saturated sets.
    "porcelain": LightRig(
        (
            Softbox((-5.0, 4.2, 1.2), 1.3, 1.3, (560.0, 489.0, 392.0), name="key"),
            Softbox((4.0, 2.5, -3.0), 0.6, 3.2, (56.0, 131.0, 317.0), name="edge"),
            Softbox((-1.0, 6.0, -2.5), 1.5, 0.8, (112.0, 112.0, 112.0), name="top"),
        ),
        sky=Sky((0.11, 0.11, 0.11), (0.056, 0.056, 0.056), (0.056, 0.056, 0.056)),
    ),
    # A red and a blue panel face each other, and mirrors take their halves from both.
    "duotone": LightRig(
        (
            Softbox((-5.0, 2.6, 0.5), 2.2, 5.0, (130.0, 22.0, 8.0), name="red"),
            Softbox((5.0, 2.6, 0.0), 2.2, 5.0, (14.0, 50.0, 150.0), name="blue"),
            Softbox((0.0, 6.0, -2.0), 3.0, 1.4, (110.0, 106.0, 100.0), name="top"),
        ),
        sky=Sky((0.02, 0.02, 0.02), (0.01, 0.01, 0.01), (0.01, 0.01, 0.01)),
    ),
    # Wide panels behind both sides: black lacquer is drawn by what it mirrors.
    "lacquer": LightRig(
        (
            Softbox((4.5, 2.6, -2.5), 1.6, 5.0, (60.0, 54.0, 46.0), name="rim"),
            Softbox((-4.5, 2.6, -3.0), 1.2, 5.0, (6.0, 16.0, 36.0), name="back"),
            Softbox((0.5, 6.0, -1.0), 3.0, 0.8, (60.0, 60.0, 60.0), name="top"),
            Softbox((-3.2, 2.2, 4.5), 0.9, 4.0, (14.0, 13.5, 13.0), name="front"),
        ),
        sky=Sky((0.12, 0.12, 0.12), (0.1, 0.1, 0.1), (0.1, 0.1, 0.1)),
    ),
    # A low window behind and a warm slit: relief and gloss of a surface that fills the picture.
    "macro": LightRig(
        (
            Softbox((-1.2, 2.2, -4.5), 2.4, 1.2, (93.0, 90.0, 82.0), name="window"),
            Softbox((3.5, 1.8, -1.0), 0.25, 2.5, (243.0, 177.0, 112.0), name="slit"),
        ),
        sky=Sky((0.19, 0.19, 0.19), (0.056, 0.056, 0.056), (0.056, 0.056, 0.056)),
    ),
    # A bright horizon behind, for the stage `ground`: glass draws its edges in black before it.
    "bright_field": LightRig(
        (Softbox((4.0, 3.0, 1.0), 0.5, 3.0, (179.0, 187.0, 195.0), name="kick"),),
        sky=Sky((0.016, 0.024, 0.049), (5.5, 4.06, 2.76), (0.032, 0.032, 0.032), visible=True),
    ),
    # A low evening sun from the side, for the stage `ground` and lenses of 74 to 88 degrees.
    "monument": LightRig(
        daylight=Daylight(
            elevation=math.radians(17.0), azimuth=math.radians(-62.0), turbidity=3.0, sun=4.1, sky=0.75
        )
    ),
}


PREFIX = "light_"
"""Beginning of the names of their layers: `light_key`."""

BACKGROUND = "background"
"""What the lens sees of the sky itself, beside subject and stage. It is in a light group as lights are."""

_MAX_HALF = float(np.finfo(np.float16).max)


@dataclass(frozen=True)
class LightGroup:
    """Lights that share one light group.

    name    of the group
    lights  their names in the rig, and BACKGROUND
    """

    name: str
    lights: tuple[str, ...]

    @property
    def layer(self) -> str:
        """The name of its layer."""
        return PREFIX + self.name


def light_layers(names: Iterable[str]) -> list[str]:
    """Return the names of the layers of light groups, in the order of their sum."""
    return sorted(name for name in names if name.startswith(PREFIX))


def groups_in(arrays: Mapping[str, Pixels]) -> dict[str, Pixels]:
    """Return the light groups (H, W, 3) among the layers of a frame, by group, in the order of their sum."""
    return {name.removeprefix(PREFIX): arrays[name] for name in light_layers(arrays)}


def with_beauty(groups: Mapping[str, NDArray[Any]]) -> dict[str, Pixels]:
    """Return the layers of light groups (H, W, 3) and `beauty`, their sum.

    Groups are rounded to half float before they are added, in alphabetical order and float32. So the groups
    in a file, added likewise, are the beauty in the file to the last bit.
    """
    layers = {
        PREFIX + name: np.clip(groups[name], -_MAX_HALF, _MAX_HALF).astype(np.float16).astype(np.float32)
        for name in sorted(groups)
    }
    beauty = np.zeros_like(next(iter(layers.values())))
    for layer in layers.values():
        beauty += layer
    return {"beauty": beauty, **layers}


@dataclass(frozen=True)
class SampledEmitter:
    """An emitter for next event estimation.

    name      of its shape or emitter in the scene
    strength  luminance times area, or irradiance of a distant light; None where it is unknown
    position  of its middle, scene units; None for a distant light
    facing    direction it shines to; None where `strength` is
    daylight  that it is, or None
    """

    name: str
    strength: float | None = None
    position: Triple | None = None
    facing: Triple | None = None
    daylight: Daylight | None = None


def sampled_emitters(lights: LightRig, to_scene: NDArray[np.float64]) -> list[SampledEmitter]:
    """Return the emitters of a rig to sample. to_scene: similarity transform (4, 4) from stage units"""
    turn, scale = to_scene[:3, :3], float(np.cbrt(np.linalg.det(to_scene[:3, :3])))
    sampled = []
    for index, box in enumerate(lights.softboxes):
        strength = float(LUMA @ box.radiance) * box.width * box.height * scale**2
        position = turn @ box.position + to_scene[:3, 3]
        facing = unit(turn @ np.subtract(box.target, box.position))
        sampled.append(SampledEmitter(f"softbox{index}", strength, triple(position), triple(facing)))
    for index, sun in enumerate(lights.suns):
        facing = unit(turn @ sun.direction)
        sampled.append(SampledEmitter(f"sun{index}", float(LUMA @ sun.irradiance), None, triple(facing)))
    if lights.daylight:
        sampled.append(SampledEmitter("sky", daylight=lights.daylight))
    elif lights.environment:
        sampled.append(SampledEmitter("sky"))
    return sampled


@dataclass(frozen=True)
class SunDisc:
    """The sun within the emitter `sky`, where the two are in different groups.

    direction  unit vector to its middle
    cosine     of the angle between its middle and its edge
    fraction   of the light there that is the sun's, by channel
    group      index of its group
    """

    direction: Triple
    cosine: float
    fraction: Triple
    group: int
