"""Finishes of floors and wear of looks: seen near, quiet from afar, and carried by the material."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from flowsculpt.pipeline.errors import ShotError
from flowsculpt.pipeline.shot import read_shot
from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.base.serialise import to_plain
from flowsculpt.render.mitsuba.engine import Engine
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene_stage import STAGES, Stage
from flowsculpt.render.scene.surface import Surface
from flowsculpt.render.scene.surface_detail import FINISHES, WEAR, worn
from tests.render.conftest import CAMERA

QUALITY = Quality(64, 36, samples=4, depth=3, auxiliary_samples=16)
HEAD = "title: A\nframes: 1-2\nsubject: {solid: box}\nresample: {max_edge_length: 0.5}\n"

Rendered = Callable[..., RenderedFrame]


@pytest.fixture(autouse=True)
def _compiled(engine: Engine) -> None:
    if engine.variant == "scalar_rgb":
        pytest.skip("finishes and wear need a compiled variant")


def test_a_finish_varies_near_the_lens_and_keeps_the_colour_of_the_floor(rendered: Rendered) -> None:
    even = rendered(quality=QUALITY)
    shown = rendered(quality=QUALITY, stage=replace(STAGES["cyclorama"], finish="concrete"))
    floor = even["matte"] == 0.0
    assert shown["albedo"][floor].mean() == pytest.approx(even["albedo"][floor].mean(), rel=0.2)
    assert shown["albedo"][floor].std() > 0.01 > even["albedo"][floor].std()


def test_a_finish_is_quiet_from_afar(rendered: Rendered) -> None:
    felt = replace(STAGES["ground"], finish="felt")

    def contrast(distance: float) -> float:
        x, y, z = (distance * part for part in CAMERA.origin)
        camera = replace(CAMERA, origin=(x, y, z))
        albedo = rendered(quality=QUALITY, stage=felt, camera=camera)["albedo"][-8:]
        return float(albedo.std() / albedo.mean())

    assert contrast(1.0) > 3.0 * contrast(30.0)


@pytest.mark.parametrize("kind", WEAR)
def test_wear_changes_the_subject_alone_and_moves_with_its_material(
    kind: str, rendered: Rendered, sphere: Surface
) -> None:
    def shown(rest: np.ndarray) -> RenderedFrame:
        surface = replace(sphere, rest=rest.astype(np.float32))
        return rendered(
            surface=surface, look=LOOKS["glaze"].with_values(wear=worn({kind: 1.0})), quality=QUALITY
        )

    bare = rendered(look=LOOKS["glaze"], quality=QUALITY)
    here, moved = shown(sphere.vertices), shown(sphere.vertices + np.array([0.7, 0.3, 0.9]))
    inside, outside = here["matte"] == 1.0, here["matte"] == 0.0
    assert np.abs(here["beauty"] - bare["beauty"])[inside].mean() > 5e-4
    assert np.array_equal(here["albedo"][outside], bare["albedo"][outside])
    assert np.abs(here["beauty"] - moved["beauty"])[inside].mean() > 1e-4


def test_a_finish_of_the_plinth_is_on_the_plinth_alone(rendered: Callable[..., RenderedFrame]) -> None:
    stage = replace(STAGES["plinth"], plinth_colour=(0.5, 0.3, 0.1))
    bare, stone = (
        rendered(stage=replace(stage, plinth_finish=finish), quality=QUALITY)["albedo"]
        for finish in ("", "concrete")
    )
    on_plinth = np.abs(bare - stage.plinth_colour).max(axis=2) < 0.01
    assert np.abs(stone - bare)[on_plinth].mean() > 5e-3
    floor = np.abs(bare - stage.colour).max(axis=2) < 0.01
    assert np.array_equal(stone[floor], bare[floor])


def test_looks_and_stages_without_it_have_the_keys_that_they_had() -> None:
    assert "wear" not in to_plain(LOOKS["glaze"]) and not {"finish", "plinth_finish"} & set(to_plain(Stage()))


def test_shots_write_wear_and_finishes() -> None:
    text = "look: {material: glaze, wear: {dust: 0.4, scratches: 0}}\nstage: {kind: ground, finish: felt}\n"
    picture = read_shot("a.yaml", HEAD + text).picture
    assert picture.look == LOOKS["glaze"].with_values(wear=worn({"dust": 0.4}))
    assert picture.stage.finish == "felt" and set(FINISHES) == {
        "polished",
        "concrete",
        "paper",
        "felt",
        "water",
    }


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("look: {material: glass, wear: {dust: 1}}", "shows no wear"),
        ("look: {material: clay, wear: {dust: 2}}", "2"),
        ("look: {material: clay, wear: {dusty: 1}}", "dust"),
        ("stage: {kind: cyclorama, finish: wood}", "finish"),
        ("stage: {kind: none, finish: felt}", "finish"),
        ("stage: {kind: ground, plinth_finish: felt}", "plinth_finish"),
    ],
)
def test_wear_and_finishes_that_cannot_be_are_refused(text: str, message: str) -> None:
    with pytest.raises(ShotError, match=message):
        read_shot("a.yaml", f"{HEAD}{text}\n")
    with pytest.raises(BadInputError):
        worn({"rust": 1.0})
