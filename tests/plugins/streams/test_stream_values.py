"""What surfaces and lines from seeds measure, against velocities whose measures are known."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flowsculpt.api import ShotError
from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.production.request.shading import Shading, dice
from flowsculpt.pipeline.shot import read_shot
from flowsculpt.render.scene.measured_colours import Measure, values_at_vertices
from flowsculpt.render.scene.surface import Surface

LINE = "{line: [[0.2, 0, 0], [1, 0, 0]]}"
KINDS = ("streak_surface", "path_surface", "stream_surface", "streak_lines", "path_lines", "stream_lines")
SPIN = "rotation: {axis: y, speed: 90}"
RATE = np.radians(90.0)


def shot_of(kind: str, values: str, velocity: str = SPIN, scale: str = "{}", more: str = "") -> Any:
    both = "length: 0.5, direction: both, " if kind.startswith("stream_") else ""
    count = "count: 3, radius: 0.001, " if kind.endswith("lines") else ""
    subject = (
        f"{{{kind}: {LINE}, velocity: [{{{velocity}}}], {both}{count}max_edge_length: 0.1, values: {values}}}"
    )
    text = (
        f"title: T\nframes: 1-4\nsubject: {subject}\nlook: {{material: clay, measure: {{values: {scale}}}}}\n"
    )
    return read_shot(Path("a.yaml"), text + more)


def measured(kind: str, values: str, velocity: str = SPIN) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return vertices of the last frame, their coordinates, and what is measured there."""
    *_, last = animate(shot_of(kind, values, velocity))
    summed, known = last.mesh.attributes["values"].T
    assert (known == 1.0).all()
    return last.mesh.vertices, last.material, summed


@pytest.mark.parametrize("kind", KINDS)
def test_what_turns_as_a_whole_is_faster_outside_and_nothing_in_it_lengthens(kind: str) -> None:
    points, _, speed = measured(kind, "speed")
    assert speed == pytest.approx(RATE * np.linalg.norm(points[:, [0, 2]], axis=1), rel=0.01)
    assert measured(kind, "vorticity")[2] == pytest.approx(2.0 * RATE, rel=1e-6)
    assert measured(kind, "stretching")[2] == pytest.approx(1.0, abs=1e-4)
    assert measured(kind, "ftle")[2] == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize("kind", KINDS)
def test_ages_count_from_the_release(kind: str) -> None:
    points, _, age = measured(kind, "age")
    turned = np.abs(np.arctan2(points[:, 2], points[:, 0]))  # all have left the x axis
    assert np.abs(age) == pytest.approx(turned / RATE, abs=0.01)
    assert age.min() < -0.4 if kind.startswith("stream_") else age.min() == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("kind", ["streak_surface", "path_surface", "path_lines"])
def test_a_strain_stretches_by_its_exponent(kind: str) -> None:
    strain = "strain: {axis: z, rate: 1}"
    _, _, age = measured(kind, "age", strain)
    assert measured(kind, "stretching", strain)[2] == pytest.approx(np.exp(age), rel=1e-4)
    assert measured(kind, "ftle", strain)[2] == pytest.approx(1.0, abs=1e-3)


def test_values_reach_what_is_rendered_also_in_its_finer_pieces_and_both_sides_of_a_shell() -> None:
    shot = shot_of("path_surface", "speed", more="")
    frame = next(iter(animate(shot, only=frozenset({3}))))
    arrays = Shading.of(frame, shot.motion.thresholds_at(3), 1).stored()
    for shown in (arrays, dice(arrays, 3)):
        surface = Surface(shown["vertices"], shown["normals"], shown["faces"], {"values": shown["values"]})
        expected = RATE * np.linalg.norm(shown["vertices"][:, [0, 2]], axis=1)
        assert values_at_vertices(surface) == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("kind", ["streak_surface", "path_lines", "stream_lines"])
def test_a_range_in_percent_is_that_of_all_frames_whichever_have_come(kind: str) -> None:
    pattern = shot_of(kind, "speed", scale="{range: [0%, 100%]}").picture.look.pattern
    assert isinstance(pattern, Measure) and pattern.follows_all_frames
    values = [f.mesh.attributes["values"][:, 0] for f in animate(shot_of(kind, "speed"))]
    every = np.concatenate(values)
    assert pattern.range == pytest.approx((every.min(), every.max()))
    again = shot_of(kind, "speed", scale="{range: [25%, 0.9]}").picture.look.pattern
    assert again.range == pytest.approx((np.quantile(every, 0.25), 0.9), rel=0.02)


def test_values_change_the_keys_of_meshes_and_the_look_does_not() -> None:
    def keys(*given: str) -> list[Any]:
        motion = shot_of(*given).motion
        return [motion.animated.data(number) for number in motion.frames]

    assert keys("path_lines", "speed") == keys(
        "path_lines", "speed", SPIN, "{colours: thermal, range: [1, 2]}"
    )
    assert keys("path_lines", "speed") != keys("path_lines", "age")


@pytest.mark.parametrize(
    ("values", "scale", "place", "message"),
    [
        ("sped", "{}", "3", "'sped' is not a measure. Did you mean 'speed'?"),
        ("speed", "{colours: termal}", "4", "'termal' is not a palette. Did you mean 'thermal'?"),
        ("speed", "{range: [2, 1]}", "4", "the first is below the second"),
        ("speed", "{range: [0, 1], log: true}", "4", "which needs numbers above 0"),
        ("speed", "{range: [1, 2], colours: balance}", "4", "(centre sets another)"),
        ("speed", "{range: [2 %, 200%]}", "4", "range.1"),
    ],
)
def test_mistakes_are_named_with_their_place_and_remedy(
    values: str, scale: str, place: str, message: str
) -> None:
    with pytest.raises(ShotError, match=rf"a\.yaml:{place}:") as caught:
        shot_of("path_surface", values, scale=scale)
    assert message in str(caught.value)


def test_values_of_a_solid_are_refused_with_the_subjects_that_have_some() -> None:
    text = "title: T\nframes: 1-4\nsubject: {solid: box, values: speed}\nresample: off\n"
    with pytest.raises(ShotError, match=r"a\.yaml:3:.*It is for .*path_surface.*, not for solid") as caught:
        read_shot(Path("a.yaml"), text)
    assert "sequence" in str(caught.value) and "streak_lines" in str(caught.value)


@pytest.mark.parametrize(("values", "expected"), [("speed", 2.0), ("vorticity", 6.0)])
def test_data_without_units_show_their_own_numbers_however_they_are_placed(
    tmp_path: Path, values: str, expected: float
) -> None:
    """Velocities (2, 0, 0) + 6 y: at the seeds, whose y is 0, the speed is 2 and the vorticity 6."""
    axis = np.linspace(-2.0, 2.0, 9)
    y = np.broadcast_to(axis[None, :, None, None], (9, 9, 9, 1))
    np.savez(tmp_path / "shear.npz", x=axis, y=axis, z=axis, velocity=(2.0 + 6.0 * y) * [1.0, 0.0, 0.0])
    text = "title: T\nframes: 1-2\nlook: {material: clay, measure: {values: {range: [0, 9]}}}\nsubject:\n"
    text += "  path_surface: {line: [[0, 0, -0.2], [0, 0, 0.2]]}\n  max_edge_length: 0.1\n"
    text += "  velocity: [{sampled: {file: shear.npz, scale: 0.5, strength: 0.1}}]\n"
    *_, last = animate(read_shot(tmp_path / "a.yaml", text + f"  values: {values}\n"))
    assert last.mesh.attributes["values"][:, 0] == pytest.approx(expected, rel=1e-3)


def test_a_look_of_values_needs_a_subject_that_has_some() -> None:
    text = "title: T\nframes: 1-4\nsubject: {solid: box}\nresample: off\n"
    text += "look: {material: clay, measure: {values: {}}}\n"
    with pytest.raises(
        ShotError,
        match=r"a\.yaml:5:.* look shows values, and the subject has none. Flows move it: write measure",
    ):
        read_shot(Path("a.yaml"), text)


def test_a_logarithm_of_values_that_reach_0_is_refused_where_it_shows() -> None:
    pattern = shot_of("path_surface", "age", scale="{range: [0%, 100%], log: true}").picture.look.pattern
    with pytest.raises(Exception, match="they reach down to 0; write a range of numbers above 0"):
        pattern.range  # noqa: B018
