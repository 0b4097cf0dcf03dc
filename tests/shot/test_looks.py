"""Looks in shot files: what can be said, and how what is wrong is told; what they leave alone."""

from __future__ import annotations

from pathlib import Path

import pytest

from flowsculpt.pipeline.errors import ShotError
from flowsculpt.pipeline.shot import Shot, read_shot
from flowsculpt.render.scene.materials import LOOKS, Absorption
from flowsculpt.render.scene.patterns import PATTERNS, Pigment
from flowsculpt.render.scene.surface import Wireframe

HEAD = "title: T\nframes: 1-24\nsubject: {solid: %s}\nresample: off\nlook: %s\n"
TWO = "colours: [[0.8, 0.7, 0.6], [0.1, 0.1, 0.1]]"


def shot_of(folder: Path, look: str, subject: str = "icosphere") -> Shot:
    return read_shot(folder / "a.yaml", HEAD % (subject, look))


@pytest.mark.parametrize("pattern", PATTERNS)
def test_every_pattern_can_be_written(pattern: str, tmp_path: Path) -> None:
    said = f"{{material: glaze, pigment: {{{pattern}: {{{TWO}, scale: 0.4, axis: x, seed: 7}}}}}}"
    look = shot_of(tmp_path, said).picture.look
    assert look.pigment is not None and look.model == LOOKS["glaze"].model
    assert (look.pigment.pattern, look.pigment.seed) == (pattern, 7)
    assert look.pigment.axis == (1.0, 0.0, 0.0)
    assert look.pigment.colours == ((0.8, 0.7, 0.6), (0.1, 0.1, 0.1))


def test_what_a_layer_does_not_say_has_the_default_of_the_code(tmp_path: Path) -> None:
    said = f"{{material: clay, pigment: {{layers: {{{TWO}}}}}}}"
    assert shot_of(tmp_path, said).picture.look.pigment == Pigment(
        "layers", ((0.8, 0.7, 0.6), (0.1, 0.1, 0.1))
    )


def test_glass_and_smoke_take_their_own_numbers(tmp_path: Path) -> None:
    assert shot_of(tmp_path, "{material: honey, refraction: 1.6}").picture.look.refraction == 1.6
    assert shot_of(tmp_path, "{material: smoke, density: 3}").picture.look.density == 3.0


def test_a_colour_takes_the_place_of_what_the_look_had_built_in(tmp_path: Path) -> None:
    assert shot_of(tmp_path, "marble").picture.look.pigment is not None
    assert shot_of(tmp_path, "{material: marble, colour: [0, 0, 1]}").picture.look.pigment is None
    tinted = shot_of(tmp_path, "{material: glass, colour: [0, 0, 1]}").picture.look
    assert (tinted.colour, tinted.absorption) == ((0.0, 0.0, 1.0), None)


@pytest.mark.parametrize(
    ("radius", "expected"), [("0.1", (0.1, 0.1, 0.1)), ("[0.4, 0.2, 0.1]", (0.4, 0.2, 0.1))]
)
def test_a_subsurface_radius_is_a_number_or_one_for_each_colour(
    radius: str, expected: tuple[float, ...], tmp_path: Path
) -> None:
    look = shot_of(tmp_path, f"{{material: marble, subsurface: {{radius: {radius}}}}}").picture.look
    assert look.subsurface.radius == expected


def test_absorption_is_said_by_colour_and_depth(tmp_path: Path) -> None:
    look = shot_of(
        tmp_path, "{material: honey, absorption: {colour: [0.5, 0.4, 0.3], depth: 2}}"
    ).picture.look
    assert look.absorption == Absorption((0.5, 0.4, 0.3), 2.0)
    assert look.colour == LOOKS["honey"].colour


def test_edges_are_drawn_over_any_look(tmp_path: Path) -> None:
    look = shot_of(tmp_path, "{material: glass, wireframe: {colour: [1, 1, 1], width: 2}}").picture.look
    assert look.wireframe == Wireframe((1.0, 1.0, 1.0), 2.0)
    assert shot_of(tmp_path, "{material: clay, wireframe: {}}").picture.look.wireframe == Wireframe()


def test_scratches_lie_across_an_axis(tmp_path: Path) -> None:
    assert shot_of(tmp_path, "{material: brushed, grain: x}").picture.look.grain == (1.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("look", "told"),
    [
        ("hony", "a.yaml:5:1: look: 'hony' is not a look. Did you mean 'honey'?"),
        (f"{{material: clay, pigment: {{mable: {{{TWO}}}}}}}", "Did you mean 'marble'?"),
        (f"{{material: clay, pigment: {{marble: {{{TWO}, shar: 1}}}}}}", "Did you mean 'share'?"),
        (f"{{material: clay, pigment: {{layers: {{{TWO}, scale: 0}}}}}}", "must be above 0"),
        ("{material: clay, pigment: {layers: {colours: [[1, 1, 1]]}}}", "must have at least 2"),
        (
            "{material: clay, pigment: {}}",
            "rings, radial, marble, speckles, spots, chips, palette, and this has none",
        ),
        (f"{{material: clay, colour: [1, 1, 1], pigment: {{layers: {{{TWO}}}}}}}", "Remove one of them"),
        (f"{{material: glass, pigment: {{layers: {{{TWO}}}}}}}", "light goes through glass"),
        ("{material: clay, density: 2}", "take smoke"),
        ("{material: clay, absorption: {colour: [1, 1, 1]}}", "take honey, glass or frosted"),
        ("{material: glass, absorption: {color: [1, 1, 1]}}", "look.absorption.color: unknown name"),
        ("{material: glass, absorption: {colour: [0, 1, 1]}}", "must be above 0"),
        ("{material: clay, wireframe: {width: 0}}", "must be above 0"),
        ("{material: clay, wireframe: {widths: 1}}", "Did you mean 'width'?"),
        (f"{{material: brushed, pigment: {{layers: {{{TWO}}}}}}}", "scratches make the pattern of brushed"),
    ],
)
def test_mistakes_are_told_at_their_line(look: str, told: str, tmp_path: Path) -> None:
    with pytest.raises(ShotError) as error:
        shot_of(tmp_path, look)
    assert "a.yaml:5:" in str(error.value) and told in str(error.value)


@pytest.mark.parametrize(
    "look", ["glass", "{bsdf: {type: dielectric}}", "{bsdf: {type: twosided, bsdf: {type: roughdielectric}}}"]
)
def test_light_does_not_go_through_a_sheet(look: str, tmp_path: Path) -> None:
    with pytest.raises(ShotError, match="a sheet is open"):
        shot_of(tmp_path, look, "sheet")


def test_a_thin_pane_may_be_a_sheet(tmp_path: Path) -> None:
    assert shot_of(tmp_path, "{bsdf: {type: thindielectric}}", "sheet").picture.look.is_clear


def test_a_pigment_is_no_part_of_the_motion(tmp_path: Path) -> None:
    plain = shot_of(tmp_path, "clay")
    veined = shot_of(tmp_path, f"{{material: clay, pigment: {{marble: {{{TWO}}}}}}}")
    assert veined.motion == plain.motion and veined.picture != plain.picture
