"""Materials of Mitsuba, written out: what they may say is what Mitsuba takes, and what they become."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.base.serialise import from_plain, to_plain
from flowsculpt.render.mitsuba.bsdf_plugins import load_error, parse_reason, refusal
from flowsculpt.render.mitsuba.engine import Engine
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.materials import LOOKS, MitsubaMaterial
from flowsculpt.render.scene.materials.mitsuba_bsdf import BSDFS, PLUGINS, TEXTURES, Bsdf
from flowsculpt.render.scene.surface import Surface
from flowsculpt.render.scene.textures import Texture

Rendered = Callable[..., RenderedFrame]

TEXTS = {"material": "Au", "distribution": "ggx", "filter_type": "nearest", "wrap_mode": "repeat"}
VALUES: dict[str, Any] = {"texture": 0.3, "number": 0.3, "bool": True, "index": 1.6}


def whole(kind: str) -> dict[str, Any]:
    """A plugin with everything that it may say."""
    form = PLUGINS[kind]
    said: dict[str, Any] = {"type": kind}
    for name, wanted in form.parameters.items():
        said[name] = 0 if wanted == "file" else TEXTS.get(name) or VALUES.get(wanted)
    if kind == "rgb":
        said["value"] = [0.3, 0.3, 0.3]
    if "eta" in said and "k" in said:  # or the name of a metal
        del said["eta"], said["k"]
    if "ext_ior" in said:  # the other side
        said["ext_ior"] = 1.0
    if kind == "principled":  # or the index
        del said["specular"]
    if "alpha_u" in said:  # or one for both
        del said["alpha"]
    said |= {f"part{i}": {"type": "diffuse"} for i in range(form.materials[1])}
    return said | {f"picture{i}": {"type": "bitmap", "filename": 0} for i in range(form.textures)}


def bsdf(**said: Any) -> Bsdf:
    return Bsdf(json.dumps(said), files=(Texture("0" * 64),))


def look(**said: Any) -> MitsubaMaterial:
    return MitsubaMaterial.of(bsdf(**said))


@pytest.mark.parametrize("kind", [kind for kind in BSDFS if kind != "measured"])
def test_mitsuba_takes_all_that_its_materials_may_say(kind: str, engine: Engine) -> None:
    assert load_error(bsdf(**whole(kind))) == []


@pytest.mark.parametrize("kind", TEXTURES)
def test_mitsuba_takes_all_that_its_textures_may_say(kind: str, engine: Engine) -> None:
    assert load_error(bsdf(type="diffuse", reflectance=whole(kind))) == []


def test_what_mitsuba_has_against_a_material_is_told_without_its_own_code(engine: Engine) -> None:
    way, why = load_error(bsdf(type="roughconductor", material="Auu"))
    assert way == [] and "Auu" in why and "spectrum.cpp" not in why and "dictionary" not in why
    way, why = load_error(bsdf(type="diffuse", reflectance=[0.1, 0.2, 3.0]))
    assert "range [0, 1]" in why
    assert parse_reason("something else") == ((), "something else")


def test_mitsuba_is_asked_in_a_process_of_its_own_and_once() -> None:
    wrong = bsdf(type="roughplastic", distribution="gx")
    refused = refusal(wrong)
    assert refused is not None and "beckmann" in refused[1]
    assert refusal(wrong) == refused
    assert refusal(bsdf(type="diffuse", reflectance=[0.5, 0.5, 0.5])) is None


def test_a_material_written_out_is_rendered_as_the_look_of_the_same_values(
    rendered: Rendered, sphere: Surface
) -> None:
    marked = replace(sphere, rest=sphere.vertices)
    own = rendered(surface=marked, look=LOOKS["clay"])
    same = rendered(surface=marked, look=look(type="diffuse", reflectance=list(LOOKS["clay"].colour)))
    inside = own["matte"] == 1.0  # noise differs with the tangents
    assert same["beauty"][inside].mean() == pytest.approx(own["beauty"][inside].mean(), rel=0.02)
    assert abs(same["albedo"] - own["albedo"]).max() < 1e-3


def test_light_goes_through_what_is_clear(rendered: Rendered, sphere: Surface) -> None:
    glass = look(type="dielectric", int_ior=1.5)
    assert glass.is_clear and not look(type="twosided", a={"type": "diffuse"}).is_clear
    assert look(type="bumpmap", a={"type": "roughdielectric"}).is_clear
    marked = replace(sphere, rest=sphere.vertices)
    layers = rendered(surface=marked, look=glass)
    inside = layers["matte"] == 1.0
    assert layers["beauty"][inside].mean() > 0.05 and layers["albedo"][inside].mean() > 0.3


def test_a_material_that_mitsuba_refuses_is_one_message_at_the_frame(
    rendered: Rendered, sphere: Surface
) -> None:
    marked = replace(sphere, rest=sphere.vertices)
    with pytest.raises(BadInputError, match=r"look's bsdf cannot be made: .*Auu"):
        rendered(surface=marked, look=look(type="conductor", material="Auu"))


def test_a_material_written_out_survives_being_written_down() -> None:
    made = look(type="diffuse", reflectance=[0.1, 0.2, 0.3])
    assert made.colour == (0.1, 0.2, 0.3)
    assert from_plain(type(made), to_plain(made)) == made
