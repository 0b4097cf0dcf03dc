"""Surfaces with holes: light, shadows, mattes and features are those of the part that is there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.mitsuba.engine import Engine
from flowsculpt.render.mitsuba.mitsuba_scene import build_scene
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.materials import LOOKS, Diffuse, Opacity, Painted, PatternedMaterial, Satin
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene import Scene
from flowsculpt.render.scene.scene_lights import LIGHTS
from flowsculpt.render.scene.scene_stage import STAGES, StagePlacement
from flowsculpt.render.scene.surface import Surface
from flowsculpt.render.scene.textures import Texture, read_alpha
from tests.render.test_painted import PLACED, square
from tests.render.test_textures import GREEN, WHITE, write

Rendered = Callable[..., RenderedFrame]

QUALITY = Quality(64, 36, 16, depth=4)
CAMERA = Camera((3.0, 2.6, 7.0), (0.3, 0.7, 0.0))


@pytest.fixture(autouse=True)
def _compiled(engine: Engine) -> None:
    if engine.variant == "scalar_rgb":
        pytest.skip("opacity needs a compiled variant")


def half(path: Path) -> Texture:
    """Numbers of a square whose left half is not there."""
    pixels = np.zeros((8, 8, 3))
    pixels[:, 4:] = 1.0
    return replace(write(path, pixels), channel=0)


def painted(*parts: PatternedMaterial) -> Painted:
    return Painted(WHITE, parts=tuple(replace(part, projection=PLACED) for part in parts))


def right_half() -> Surface:
    """The square from its middle to its right end."""
    whole = square((0, 0))
    left = whole.vertices.copy()
    left[:, 0] = np.maximum(left[:, 0], 0.0)
    return replace(whole, vertices=left, rest=left)


@pytest.mark.parametrize(("lights", "is_hidden"), [("studio", False), ("daylight", True)])
def test_a_surface_that_is_cut_out_is_rendered_as_one_that_ends_there(
    tmp_path: Path, rendered: Rendered, lights: str, is_hidden: bool
) -> None:
    holes = Opacity(texture=half(tmp_path / "a.exr"), cutoff=0.5)
    camera = replace(CAMERA, origin=(-3.0, 2.6, -7.0)) if is_hidden else CAMERA
    arguments = {"lights": LIGHTS[lights], "quality": QUALITY, "camera": camera}
    cut = rendered(surface=square((0, 0)), look=painted(Diffuse(GREEN, opacity=holes)), **arguments)
    whole = rendered(surface=right_half(), look=painted(Diffuse(GREEN)), **arguments)
    assert 0.03 < whole["matte"].mean() < 0.3
    for name in ("matte", "depth", "normal", "position", "albedo", "beauty"):
        scale = np.abs(whole[name]).max()
        differs = np.abs(cut[name] - whole[name]).reshape(36, 64, -1).max(axis=2) > 2e-3 * scale
        assert differs.mean() < (0.004 if name == "beauty" else 0.002), name


def test_each_material_has_its_own_holes(rendered: Rendered) -> None:
    gone, whole = Diffuse(GREEN, opacity=Opacity(0.0)), Satin(GREEN, roughness=0.5)
    looks = painted(Diffuse(GREEN), whole), painted(gone, whole), painted(Diffuse(GREEN), gone)
    arguments = {"surface": square((0, 1)), "quality": replace(QUALITY, depth=2), "camera": CAMERA}
    both, second, first = (rendered(look=look, **arguments)["matte"] for look in looks)
    assert first.sum() > 0.2 * both.sum() < 5.0 * second.sum()
    assert np.abs(first + second - both).max() < 0.07  # a sample on the edge between them


def test_a_fraction_is_there_in_so_many_samples_and_in_light_and_mattes_alike(rendered: Rendered) -> None:
    look, arguments = painted(Diffuse(GREEN, opacity=Opacity(0.25))), {"camera": CAMERA}
    quality = replace(QUALITY, samples=64, auxiliary_samples=64, depth=2)
    thin = rendered(surface=square((0, 0)), look=look, quality=quality, **arguments)
    whole = rendered(surface=square((0, 0)), look=painted(Diffuse(GREEN)), quality=quality, **arguments)
    inside = whole["matte"].reshape(36, 64) > 0.999
    assert thin["matte"].reshape(36, 64)[inside].mean() == pytest.approx(0.25, abs=0.01)
    assert not thin["matte"][whole["matte"] == 0.0].any()
    floor = whole["matte"].reshape(36, 64) == 0.0
    assert thin["beauty"][floor].mean() > 1.01 * whole["beauty"][floor].mean()  # a fainter shadow


def test_colours_go_on_into_the_holes_beside_them(tmp_path: Path) -> None:
    pixels = np.zeros((4, 4, 4))
    pixels[:, 2:] = (0.2, 0.4, 0.6, 1.0)
    texture = replace(write(tmp_path / "a.exr", pixels), space="linear")
    assert read_alpha(texture.path, texture.digest)[0, :, 0].tolist() == [0.0, 0.0, 1.0, 1.0]
    holes = Opacity(texture=replace(texture, space="data", channel=Texture.ALPHA), cutoff=0.5)
    shown = Diffuse(WHITE, colour_texture=texture, opacity=holes).colour_pixels()
    assert shown == pytest.approx(np.broadcast_to((0.2, 0.4, 0.6), (4, 4, 3)))
    assert not Diffuse(WHITE, colour_texture=texture).colour_pixels()[:, :2].any()


def test_opacity_is_refused_where_shadows_would_ignore_it(engine: Engine) -> None:
    look = painted(Diffuse(GREEN, opacity=Opacity(0.5)))
    scene = Scene(square((0, 0)), look, LIGHTS["studio"], STAGES["none"], StagePlacement(), CAMERA)
    build_scene(scene, QUALITY)
    smoky = replace(scene, others=(replace(scene.subjects[0], name="smoke", material=LOOKS["smoke"]),))
    with pytest.raises(BadInputError, match=r"the opacity of a model needs .* without smoke"):
        build_scene(smoky, QUALITY)


def test_scenes_without_holes_have_no_cut_outs(sphere: Surface, engine: Engine) -> None:
    scene = Scene(sphere, LOOKS["clay"], LIGHTS["studio"], STAGES["none"], StagePlacement(), CAMERA)
    built = build_scene(scene, QUALITY)
    assert built.beauty.path_tracer.cut_outs is None and built.features.cut_outs is None
