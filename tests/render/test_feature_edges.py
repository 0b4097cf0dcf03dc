"""Auxiliary samples: a few everywhere, and all where the features of neighbouring pixels have edges."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from flowsculpt.render.frame.batch_schedule import FIRST_AUXILIARY, batch_schedule, seed_of, traced_rounds
from flowsculpt.render.frame.feature_edges import LIMITS, at_edges
from flowsculpt.render.mitsuba.engine import Engine
from flowsculpt.render.mitsuba.mitsuba_scene import build_scene
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene import Scene
from flowsculpt.render.scene.scene_lights import LIGHTS
from flowsculpt.render.scene.scene_stage import STAGES, StagePlacement
from flowsculpt.render.scene.surface import Surface

QUALITY = Quality(96, 54, samples=2, depth=2, auxiliary_samples=16)
SLOPE = np.broadcast_to(np.linspace(0.0, 1.0, 12, dtype=np.float32)[:, None], (9, 12, 1)).copy()


@pytest.mark.parametrize("name", LIMITS)
def test_a_slope_has_no_edge_and_a_step_has_one_with_its_neighbours(name: str) -> None:
    feature = SLOPE if name != "depth" else np.exp(SLOPE)
    assert not at_edges({name: feature}).any()
    stepped = feature.copy()
    stepped[:, 6:] *= 1.0 + 3.0 * LIMITS[name]
    marked = at_edges({name: stepped})
    assert np.flatnonzero(marked.any(axis=0)).tolist() == [4, 5, 6, 7]
    assert marked[:, 4:8].all()


def test_a_speck_has_an_edge_around_it() -> None:
    matte = np.zeros((9, 12, 1), np.float32)
    matte[4, 6] = 0.25
    assert np.argwhere(at_edges({"matte": matte})).tolist() == [
        [y, x] for y in range(2, 7) for x in range(4, 9) if abs(y - 4) < 2 or abs(x - 6) < 2
    ]


@pytest.mark.parametrize("crop", [None, (20, 10, 70, 41)])
def test_edges_take_all_samples_and_the_rest_is_as_exact(
    rendered: Callable[..., RenderedFrame],
    sphere: Surface,
    engine: Engine,
    crop: tuple[int, int, int, int] | None,
) -> None:
    if engine.variant == "scalar_rgb":
        pytest.skip("there all pixels take all of them")
    quality = replace(QUALITY, crop=crop)
    frame, first = (
        rendered(quality=replace(quality, auxiliary_samples=count)) for count in (16, FIRST_AUXILIARY)
    )
    camera = Camera((3.2, 2.9, 8.8), (0.0, 0.95, 0.0))
    scene = Scene(sphere, LOOKS["clay"], LIGHTS["studio"], STAGES["cyclorama"], StagePlacement(), camera)
    whole = build_scene(scene, quality).features.render(16, 0, seed_of(7, "beauty"))
    features = {
        name: first[name].reshape(*first["matte"].shape, -1) for name in ("matte", "albedo", "normal")
    }
    edges = at_edges({**features, "depth": first["depth"][..., None]})
    assert 0.03 < edges.mean() < 0.3
    for name, limit in (("albedo", 0.001), ("normal", 0.02)):
        assert np.allclose(frame[name][edges], whole[name][edges], atol=1e-6)  # batches are added in turn
        assert np.array_equal(frame[name][~edges], first[name][~edges])
        assert np.abs(frame[name] - whole[name]).max() < limit


def test_motion_takes_all_samples_of_the_shutter_everywhere() -> None:
    whole = replace(QUALITY, samples=16, auxiliary_samples=64)
    still, moving = (batch_schedule(whole, traced_rounds(whole, way, 99, 7)) for way in (0.0, 4.0))
    assert [b.samples for b in still if b.kind == "auxiliary"] == [4, 12, 16, 16, 16]
    assert [b.at_edges for b in still if b.kind == "auxiliary"] == [False, True, True, True, True]
    assert not any(batch.at_edges for batch in moving)
