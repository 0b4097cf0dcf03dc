"""Light that goes below the surface is neither made nor lost, and comes out elsewhere."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.mitsuba.engine import Engine
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.materials import Diffuse, Glass, Material, Plastic, Subsurface
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene_lights import LightRig, Sky, Softbox
from flowsculpt.render.scene.scene_stage import STAGES
from flowsculpt.render.scene.surface import Surface

COLOUR, WHITE = (0.2, 0.5, 0.8), (1.0, 1.0, 1.0)
SHALLOW, DEEP = Subsurface((0.005, 0.005, 0.005)), Subsurface((0.6, 0.3, 0.15))
FURNACE = {"lights": LightRig(sky=Sky(WHITE, WHITE, WHITE, visible=True)), "stage": STAGES["none"]}

Light = Callable[[Material], np.ndarray]


@pytest.fixture(scope="module")
def light(rendered: Callable[..., RenderedFrame], sphere: Surface, engine: Engine) -> Light:
    """Return the mean light of a sphere under a white sky."""
    if engine.variant == "scalar_rgb":
        pytest.skip("the plain variant reflects at the surface")

    def mean(look: Material) -> np.ndarray:
        layers = rendered(surface=sphere, look=look, quality=Quality(32, 18, 64, depth=12), **FURNACE)
        return np.asarray(layers["beauty"][layers["matte"] >= 0.999].mean(axis=0))

    return mean


@pytest.mark.parametrize("body", [Diffuse(COLOUR), Plastic(COLOUR, roughness=0.2)], ids=["clay", "plastic"])
def test_a_small_radius_looks_like_the_surface(body: Diffuse | Plastic, light: Light) -> None:
    assert light(replace(body, subsurface=SHALLOW)) == pytest.approx(light(body), rel=0.06)


def test_a_large_radius_lets_light_through(light: Light) -> None:
    assert (light(Diffuse(COLOUR, subsurface=DEEP)) > 1.1 * light(Diffuse(COLOUR))).all()


@pytest.mark.parametrize("radius", [SHALLOW, DEEP], ids=["shallow", "deep"])
def test_no_light_is_made_below_the_surface(radius: Subsurface, light: Light) -> None:
    pale = light(Diffuse((0.9, 0.95, 1.0), subsurface=radius))
    assert pale.max() < 1.01 and pale.min() > 0.8


def test_cloudy_glass_keeps_all_light(light: Light) -> None:
    assert light(Glass(WHITE, subsurface=Subsurface((0.3, 0.3, 0.3)))) == pytest.approx(1.0, abs=0.01)


def test_a_wall_lit_from_behind_glows(
    rendered: Callable[..., RenderedFrame], engine: Engine, light: Light
) -> None:
    from tests.render.test_looks import block

    behind = LightRig((Softbox((0.0, 0.0, -6.0), 3.0, 3.0, (20.0, 20.0, 20.0), target=(0.0, 0.0, 0.0)),))
    view = {"camera": Camera((0.0, 0.0, 9.0), (0.0, 0.0, 0.0)), "lights": behind, "stage": STAGES["none"]}
    dark, thick, thin = (
        rendered(surface=block(half), look=look, **view)["beauty"][10:17, 18:30].mean()
        for half, look in (
            (0.05, Diffuse(COLOUR)),
            (0.5, Diffuse(COLOUR, subsurface=DEEP)),
            (0.05, Diffuse(COLOUR, subsurface=DEEP)),
        )
    )
    assert dark < 1e-3 < thick < 0.5 * thin


def test_what_cannot_scatter_light_says_so() -> None:
    from flowsculpt.render.scene.textures import Texture

    with pytest.raises(BadInputError, match="each number lies between"):
        Subsurface((0.0, 1.0, 1.0))
    with pytest.raises(BadInputError, match="subsurface and a picture or pattern of roughness"):
        Plastic(COLOUR, subsurface=SHALLOW, roughness_texture=Texture("0" * 64, path="rough.png"))
