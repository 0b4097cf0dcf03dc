"""While a value is dragged the current frame follows, small and at once, and nothing is written."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import imageio.v3 as iio
import numpy as np
import pytest
from numpy.typing import NDArray

from flowsculpt.pipeline.errors import FlowsculptError
from flowsculpt.pipeline.plugins.preview.shot_editor import ShotEditor
from flowsculpt.pipeline.plugins.preview.sketch import MOST_BALLS, QUICK_VERTICES, shape_of
from flowsculpt.pipeline.plugins.preview.text_edits import ValueEdit
from flowsculpt.pipeline.plugins.preview.trial_pictures import TrialPictures
from flowsculpt.pipeline.production.request.manifest import ShotManifest
from flowsculpt.render.scene.materials import LOOKS
from tests.needed_plugins import needs_plugins
from tests.plugins.preview.live_follower import Follower

pytestmark = needs_plugins("points")


SHOT = """\
title: A block and motes
frames: 1-6
subjects:
  block:
    solid: box
    size: [1.2, 1.2, 1.2]
    place: [-0.9, 0, 0]
    flows:
      - twist: {axis: y, amount: {ease: linear, keys: {1: 0, 6: 60}}}
  motes: {cloud: {solid: icosphere, radius: 0.7}, count: 60, radius: 0.06, place: [0.9, 0, 0], look: glaze}
resample: {max_edge_length: 0.3}
flows:
  - vortex: {axis: z, centre: [0, 0, 0], radius: 1, strength: 2}
camera: {azimuth: -30, elevation: 14, target: [0, 0, 0], distance: 7}
"""

FRAME = 5


@pytest.fixture(scope="module")
def follower(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Follower]:
    made = Follower(tmp_path_factory.mktemp("trial"), SHOT)
    made.until("Up")
    yield made
    made.stream.__exit__(None, None, None)


@pytest.fixture
def pictures(follower: Follower) -> Iterator[TrialPictures]:
    """Pictures of drags in the shot, which is as it was again afterwards."""
    editor = ShotEditor(follower.shot)
    yield TrialPictures(editor, follower.session)
    if follower.shot.read_text() != SHOT:
        follower.save(SHOT)
        follower.until("Up")


def pixels(answer: dict[str, Any]) -> NDArray[Any]:
    return np.asarray(iio.imread(base64.b64decode(answer["picture"])), float)[:135]


def shown(follower: Follower) -> NDArray[Any]:
    """The full picture, as small as that of a drag."""
    drawn = follower.session.drawn(FRAME)
    assert drawn is not None
    return np.asarray(iio.imread(drawn.jpeg), float)[::2, ::2][:135]


def dragged(pictures: TrialPictures, *edits: ValueEdit) -> dict[str, Any]:
    return pictures.picture(pictures.editor.state()["digest"], edits, FRAME)


def setting(value: Any, *where: str | int) -> ValueEdit:
    return ValueEdit("set", where, value)


ELEVATION = setting(14, "camera", "elevation")


@needs_plugins("points")
def test_an_edit_that_changes_nothing_shows_the_frame_as_it_is_but_small(
    follower: Follower, pictures: TrialPictures
) -> None:
    same = dragged(pictures, ELEVATION)
    assert pixels(same).shape == (135, 240, 3)
    assert np.abs(pixels(same) - shown(follower)).mean() < 4
    twist = setting(60, "subjects", "block", "flows", 0, "twist", "amount", "keys", 6)
    assert np.abs(pixels(dragged(pictures, twist)) - pixels(same)).mean() < 1
    assert follower.shot.read_text() == SHOT


@pytest.mark.slow
@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (setting(50, "camera", "elevation"), "Drawn small"),
        (setting("chrome", "subjects", "motes", "look"), "Drawn small"),
        (setting("softbox", "lights"), "Drawn small"),
        (setting(6, "flows", 0, "vortex", "strength"), "Approximate: moved"),
        (setting(120, "subjects", "block", "flows", 0, "twist", "amount", "keys", 6), "Approximate: moved"),
        (setting([-0.9, 0.8, 0], "subjects", "block", "place"), "Approximate: a coarse"),
        (setting([0.6, 2, 0.6], "subjects", "block", "size"), "Approximate: a coarse"),
        (setting(0.16, "subjects", "motes", "radius"), "Approximate: a coarse"),
    ],
    ids=lambda value: ".".join(map(str, value.where)) if isinstance(value, ValueEdit) else "",
)
def test_whatever_is_dragged_the_picture_is_near_what_comes_after_release(
    follower: Follower, pictures: TrialPictures, edit: ValueEdit, words: str
) -> None:
    before, trial = shown(follower), dragged(pictures, edit)
    assert trial["words"].startswith(words)
    pictures.editor.edit(pictures.editor.state()["digest"], [edit])
    follower.until("Up")
    after = shown(follower)
    assert np.abs(before - after).mean() > 0.5
    assert np.abs(pixels(trial) - after).mean() < 0.6 * np.abs(before - after).mean() + 1.0


@needs_plugins("points")
def test_a_drag_of_edge_lengths_shows_the_frame_and_says_that_the_mesh_comes_later(
    follower: Follower, pictures: TrialPictures
) -> None:
    trial = dragged(pictures, setting(0.2, "resample", "max_edge_length"))
    assert "when you let go" in trial["words"]
    assert np.abs(pixels(trial) - shown(follower)).mean() < 4


@needs_plugins("points")
@pytest.mark.parametrize(
    "edit",
    [setting(50, "camera", "elevation"), setting(6, "flows", 0, "vortex", "strength")],
    ids=["camera", "flow"],
)
def test_what_is_prepared_while_the_pointer_goes_down_changes_no_picture(
    pictures: TrialPictures, edit: ValueEdit
) -> None:
    prepared = TrialPictures(pictures.editor, pictures.session)
    prepared.prepare(edit.where, FRAME)
    assert dragged(prepared, edit) == dragged(pictures, edit)
    prepared.prepare(edit.where, 9)  # a frame that is not there


@needs_plugins("points")
def test_a_value_that_the_shot_cannot_have_is_refused_with_its_place(pictures: TrialPictures) -> None:
    with pytest.raises(FlowsculptError, match="elevation"):
        dragged(pictures, setting("high", "camera", "elevation"))
    with pytest.raises(FlowsculptError, match="frame 9 is not simulated yet"):
        pictures.picture(pictures.editor.state()["digest"], [ELEVATION], 9)


@needs_plugins("points")
def test_a_drag_waits_for_subjects_that_are_not_simulated_yet(
    pictures: TrialPictures, tmp_path: Path
) -> None:
    edited = tmp_path / "T010_tiny.yaml"
    edited.write_text(SHOT.replace("resample:", "  third: {solid: icosphere, radius: 0.2}\nresample:", 1))
    elsewhere = TrialPictures(ShotEditor(edited), pictures.session)
    with pytest.raises(FlowsculptError, match="other subjects are simulated first"):
        dragged(elsewhere, ELEVATION)
    with pytest.raises(FlowsculptError, match="shows when you let go"):
        dragged(pictures, ValueEdit("set", ("rate",), 25))


@needs_plugins("points")
def test_a_drag_plans_no_frames(pictures: TrialPictures, monkeypatch: pytest.MonkeyPatch) -> None:
    """Keys of all frames take longer, the longer a shot is."""
    dragged(pictures, ELEVATION)  # what is shown is planned
    monkeypatch.setattr(ShotManifest, "of", lambda shot: pytest.fail("planned"))
    dragged(pictures, setting(30, "camera", "elevation"), setting(6, "flows", 0, "vortex", "strength"))
    dragged(pictures, setting([0.6, 2, 0.6], "subjects", "block", "size"), setting("glaze", "look"))


@needs_plugins("points")
def test_a_drag_that_follows_another_need_not_wait_for_the_simulation(follower: Follower) -> None:
    """The surfaces that the page shows stay until those of the edited shot replace them."""
    stream, drawn = follower.stream, follower.session.drawn(FRAME)
    assert drawn is not None
    edited = drawn.sketch.request
    next(stream.play(edited, [1], [(drawn.sketch.request, FRAME)]))
    assert stream.knows(drawn.sketch.request, FRAME)


@pytest.mark.parametrize("count", [40, 3000, MOST_BALLS])
def test_points_drawn_as_coarse_balls_cover_as_much_of_a_picture_as_spheres(count: int) -> None:
    points = np.random.default_rng(1).random((count, 3))
    arrays = {"vertices": points, "radii": np.full(count, 0.02), "material": points}
    shape = shape_of(arrays, LOOKS["clay"], quick=True)
    assert len(shape.vertices) <= max(QUICK_VERTICES, 6 * count)
    corners = shape.vertices[shape.faces]
    sides = corners[:, 1:] - corners[:, :1]
    crosses = np.cross(sides[:, 0], sides[:, 1])
    assert (np.einsum("fk,fk->f", crosses, shape.normals[shape.faces[:, 0]]) > 0).all(), "faces face outwards"
    shadows = np.linalg.norm(crosses, axis=1).sum() / 2 / 4  # the mean of a convex solid (Cauchy)
    assert shadows == pytest.approx(count * np.pi * 0.02**2)
