"""Light rigs, in stage units: the subject has a half-size of 1 and stands on the floor y = 0.

A rig is built around the subject and moved with the stage (`render.stage.Placement`); softboxes have a
radiance, not a power, so a stage of any size is equally bright.
"""

from __future__ import annotations

from dataclasses import dataclass

from render.plain import Triple


@dataclass(frozen=True)
class Softbox:
    """A glowing rectangle that faces its target; the camera does not see it, reflections do.

    position, target   stage units
    width, height      stage units; height is along the vertical
    radiance           linear Rec.709
    """

    position: Triple
    width: float
    height: float
    radiance: Triple
    target: Triple = (0.0, 1.0, 0.0)


@dataclass(frozen=True)
class Sun:
    """Parallel light with hard shadows. `direction` is where it shines to; irradiance in linear Rec.709."""

    direction: Triple
    irradiance: Triple


@dataclass(frozen=True)
class Sky:
    """Light from everywhere: a gradient from zenith through horizon to nadir, linear Rec.709 radiance."""

    zenith: Triple = (0.0, 0.0, 0.0)
    horizon: Triple = (0.0, 0.0, 0.0)
    nadir: Triple = (0.0, 0.0, 0.0)
    visible: bool = False

    @property
    def is_uniform(self) -> bool:
        return self.zenith == self.horizon == self.nadir


@dataclass(frozen=True)
class LightRig:
    """All lights of a shot. `exposure` is in stops and acts when linear light becomes a display picture."""

    softboxes: tuple[Softbox, ...] = ()
    suns: tuple[Sun, ...] = ()
    sky: Sky = Sky()
    exposure: float = 0.0


_FILL = (0.42, 0.47, 0.56)

_KEY = Softbox((-4.4, 5.4, 4.0), 1.9, 1.9, (136.0, 119.0, 97.0))
"""Warm, from the upper left front: it models the form."""

_RIM = Softbox((4.9, 3.4, -4.4), 0.55, 2.8, (110.0, 132.0, 172.0))
"""A cool strip behind on the right: it draws the lips of the creases."""

_BACK = Softbox((0.0, 8.6, -5.0), 4.0, 2.4, (15.0, 15.3, 16.0), target=(0.0, 0.0, -4.2))
"""High over the ground behind the subject, which it lifts from the wall's darkness."""

LIGHTS = {
    "studio": LightRig((_KEY, _RIM, _BACK), sky=Sky(_FILL, _FILL, _FILL)),
    # Long strips all around: a mirror shows its form only by what it has to bend.
    "gallery": LightRig(
        (
            Softbox((-5.4, 3.4, 2.6), 0.7, 5.0, (74.0, 66.0, 56.0)),
            Softbox((3.2, 3.0, 6.0), 0.35, 4.6, (40.0, 41.0, 44.0)),
            Softbox((5.2, 3.6, -3.6), 0.55, 4.4, (76.0, 90.0, 118.0)),
            Softbox((0.0, 7.6, -1.0), 5.0, 0.8, (42.0, 42.0, 42.0)),
        ),
        sky=Sky((0.30, 0.34, 0.42), (0.12, 0.13, 0.16), (0.1, 0.1, 0.1)),
    ),
}
