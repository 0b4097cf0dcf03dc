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


_FAINT_BLUE = (0.09, 0.10, 0.12)

LIGHTS = {
    "studio": LightRig(
        softboxes=(
            Softbox((-4.2, 5.6, 3.8), 1.6, 1.6, (16.0, 14.5, 12.5)),
            Softbox((4.6, 3.6, -4.2), 0.5, 2.2, (14.0, 17.0, 22.0)),
            Softbox((0.4, 7.0, -0.6), 2.0, 2.0, (1.8, 1.8, 1.8)),
        ),
        sky=Sky(_FAINT_BLUE, _FAINT_BLUE, _FAINT_BLUE),
    ),
}
