"""Streamlines drawn over a preview are those of the flow."""

from __future__ import annotations

import numpy as np
import pytest

from flowsculpt.pipeline.plugins.preview.sketch import PIECES, line_colours, shape_of, streamlines
from flowsculpt.pipeline.shot import Motion, read_shot
from flowsculpt.render.scene.materials import LOOKS

BOX = np.array([(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])

SHOT = "title: W\nframes: 1-25\nsubject: {solid: box}\nresample: off\nflows: [%s]\n"


def motion(flow: str, more: str = "") -> Motion:
    return read_shot("w.yaml", SHOT % flow + more).motion


def test_lines_about_an_axis_are_arcs_at_the_speed_of_their_radius() -> None:
    ways = streamlines(motion("rotation: {axis: z, speed: 90}"), 12, BOX)
    radius = np.hypot(ways.points[..., 0], ways.points[..., 1])
    np.testing.assert_allclose(radius, radius[:, :1] * np.ones(PIECES + 1), rtol=2e-3)
    slow = ways.speeds.max(axis=1) < 2.0
    np.testing.assert_allclose(ways.speeds[slow], radius[slow] * np.pi / 2, rtol=0.02)


@pytest.mark.parametrize(
    "flow",
    [
        "twist: {axis: z, amount: {ease: linear, keys: {1: 0, 25: 90}}}",
        "within: {region: {sphere: {radius: 1}}, flows: [twist: {axis: z, amount: {keys: {1: 0, 25: 90}}}]}",
    ],
)
def test_maps_have_lines_too(flow: str) -> None:
    ways = streamlines(motion(flow), 12, BOX)
    assert len(ways.points) > 50
    np.testing.assert_allclose(ways.points[..., 2], ways.points[:, :1, 2] * np.ones(PIECES + 1), atol=1e-9)


def test_where_nothing_moves_nothing_is_drawn() -> None:
    keyed = "vortex: {strength: {keys: {1: 0, 12: 3, 25: 3}}}"
    assert streamlines(motion("twist: {amount: 20}"), 12, BOX).points.shape == (0, PIECES + 1, 3)
    assert not len(streamlines(motion(keyed, "speed: 0\n"), 12, BOX).points)
    assert len(streamlines(motion(keyed), 12, BOX).points)
    assert line_colours(streamlines(motion("twist: {amount: 20}"), 12, BOX))[0].shape == (0, PIECES + 1, 3)


def test_lines_begin_around_the_subject_wherever_it_is() -> None:
    away = BOX * [0.2, 0.5, 0.2] + [5.0, 0.0, 0.0]
    ways = streamlines(motion("translation: {rate: [0, 1, 0]}"), 3, away)
    middle = ways.points[:, PIECES // 2]
    assert np.abs(middle[:, 0] - 5.0).max() < 0.3 and np.ptp(middle[:, 1]) > 1.0


def test_a_cloud_is_drawn_as_balls() -> None:
    points = np.array([(0.0, 0.0, 0.0), (3.0, 0.0, 0.0)])
    arrays = {"vertices": points, "radii": np.array([0.5, 1.0]), "material": points}
    shape = shape_of(arrays, LOOKS["clay"])
    away = np.linalg.norm(shape.vertices.reshape(2, -1, 3) - points[:, None], axis=2)
    np.testing.assert_allclose(away, np.ones(away.shape) * [[0.5], [1.0]])
    assert shape.faces.max() == len(shape.vertices) - 1 and len(shape.normals) == len(shape.vertices)


def test_colours_tell_the_speed_and_both_ends_fade() -> None:
    colours, opacity = line_colours(streamlines(motion("vortex: {strength: 3, radius: 0.4}"), 12, BOX))
    assert (opacity[:, [0, -1]] < 1e-9).all() and opacity.max() <= 1.0 and opacity[:, PIECES // 2].min() > 0.3
    assert np.ptp(colours[..., 0]) > 0.3
