"""Shots of several subjects: place, look, flows and copies of each, and one message a mistake."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.errors import ShotError, UsageError
from flowsculpt.pipeline.flow.regions import BoxRegion
from flowsculpt.pipeline.mesh import box, icosphere
from flowsculpt.pipeline.mesh.placed_copies import Placements
from flowsculpt.pipeline.mesh.solids import six_sided_box
from flowsculpt.pipeline.shot import Shot, read_shot
from flowsculpt.pipeline.shot.copies import Copies, bounding_sphere
from tests.needed_plugins import needs_plugins, shot_rows

SHOT = """\
title: Two
frames: 1-3
subjects:
  crane: {solid: torus, radius: 0.6, tube_radius: 0.2, place: [-1, 0, 0], look: glaze}
  heron:
    solid: icosphere
    radius: 0.5
    resample: {max_edge_length: 0.2}
    flows:
      - rotation: {axis: x, speed: 90}
resample: {max_edge_length: 0.3}
look: marble
flows:
  - twist: {axis: y, amount: {keys: {1: 0, 3: 30}}}
"""


def shot_of(text: str = SHOT) -> Shot:
    return read_shot("a.yaml", text)


def told(entry: str, rest: str = "resample: {max_edge_length: 0.3}\n") -> str:
    """Return what is said of a shot with these subjects."""
    with pytest.raises(ShotError) as error:
        read_shot("a.yaml", f"title: T\nframes: 1-3\n{rest}{entry}")
    return str(error.value)


def test_each_subject_has_its_own_settings_and_else_those_of_the_shot() -> None:
    crane, heron = shot_of().subjects
    assert (crane.subject, heron.subject) == ("crane", "heron")
    assert {crane.picture.look.model, heron.picture.look.model} == {"plastic"}
    assert crane.picture.look.colour != heron.picture.look.colour
    longest = [part.motion.resampling_at(1).thresholds.max_edge_length for part in (crane, heron)]
    assert longest == [0.3, 0.2]
    assert crane.motion.mesh_at_rest().bounds.mean(axis=0) == pytest.approx([-1, 0, 0], abs=0.01)


def test_flows_of_the_shot_move_all_subjects_and_those_of_a_subject_follow() -> None:
    crane, heron = (part.motion.flow.flows for part in shot_of().subjects)
    assert crane == heron[:1] and len(heron) == 2
    motion = shot_of().subjects[1].motion
    assert [motion.place_of_flow(k) for k in (0, 1)] == ["flows.0", "subjects.heron.flows.0"]
    shared_alone = read_shot(
        "a.yaml", SHOT.replace("    flows:\n      - rotation: {axis: x, speed: 90}\n", "")
    )
    before, after = (list(animate(shot.subjects[0]))[-1].mesh for shot in (shared_alone, shot_of()))
    assert np.array_equal(before.vertices, after.vertices), "what moves the heron leaves the crane alone"


def test_a_shot_of_one_subject_has_no_others() -> None:
    text = "title: T\nframes: 1-2\nsubject: {solid: box}\nresample: off\n"
    shot = read_shot("a.yaml", text)
    assert shot.subjects == () and shot.parts == (shot,)
    with pytest.raises(UsageError, match=r"a has no subject 'box'\. It has one subject"):
        shot.of_subject("box")


def test_a_moved_solid_keeps_its_exact_surface() -> None:
    crane = shot_of().subjects[0]
    surface = crane.motion.analytic_surface()
    assert surface is not None
    points = crane.motion.mesh_at_rest().vertices
    assert np.abs(surface(points) - points).max() < 1e-12
    ring = np.hypot(points[:, 0] + 1.0, points[:, 2]) - 0.6
    assert np.hypot(ring, points[:, 1]) == pytest.approx(0.2, abs=1e-9)


@settings(deadline=None, max_examples=30)  # a busy machine takes its time
@given(st.integers(1, 12), st.integers(0, 2**31))
def test_copies_lie_in_the_region_and_apart_and_their_seed_decides_where(count: int, seed: int) -> None:
    copies = Copies(count, seed, BoxRegion(centre=(1.0, 0.0, 0.0), size=(6.0, 4.0, 4.0)))
    middles = copies.middles(0.5)
    assert middles.shape == (count, 3)
    assert (np.abs(middles - (1.0, 0.0, 0.0)) <= np.array([2.5, 1.5, 1.5]) + 1e-9).all()
    apart = np.linalg.norm(middles[:, None] - middles, axis=2) + 10.0 * np.eye(count)
    assert apart.min() > 1.0
    assert np.array_equal(middles, copies.middles(0.5))
    assert not np.array_equal(middles, Copies(count, seed + 1, copies.region).middles(0.5))


def test_copies_are_one_mesh_of_parts_that_flows_move_at_their_places() -> None:
    text = SHOT.replace(
        "place: [-1, 0, 0]",
        "copies: {count: 3, seed: 4, region: {box: {size: [9, 3, 3], centre: [0, 0, -4]}}}",
    )
    crane = shot_of(text).subjects[0]
    mesh = crane.motion.mesh_at_rest()
    alone = crane.motion.subject.build(0.3)
    assert len(mesh.vertices) == 3 * len(alone.vertices) and len(mesh.faces) == 3 * len(alone.faces)
    frames = list(animate(crane))
    surface = crane.motion.analytic_surface()
    at_rest = frames[0].mesh.vertices
    assert surface is not None and np.abs(surface(at_rest) - at_rest).max() < 1e-9
    moved = frames[1].mesh.attributes["rest"]
    assert np.abs(surface(moved) - moved).max() < 1e-6, (
        "new vertices are placed on the copy that they belong to"
    )


def test_repeated_polygons_keep_their_sides_and_creases() -> None:
    offsets = np.array([[0.0, 0.0, 0.0], [5.0, 0.0, 0.0]])
    twice = Placements.of(offsets).repeated(six_sided_box((2.0, 2.0, 2.0)))
    assert list(twice.sides) == [4] * 12 and twice.bounds.tolist() == [[-1, -1, -1], [6, 1, 1]]
    creased = box(2.0).with_creases([[0, 1]]).with_attributes(heat=np.arange(len(box(2.0).vertices)))
    joined = Placements.of(offsets).repeated(creased)
    count = len(creased.vertices)
    assert len(joined.creases) == 2 and joined.creases[1].tolist() == [count, count + 1]
    assert np.array_equal(joined.attributes["heat"][count:], creased.attributes["heat"])


def test_the_bounding_sphere_of_a_ball_is_the_ball() -> None:
    middle, radius = bounding_sphere(icosphere(4, 2.0).vertices + np.array([1.0, 2.0, 3.0]))
    assert middle == pytest.approx([1, 2, 3], abs=0.1) and radius == pytest.approx(2.0, abs=0.1)


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("", "subject: missing; it has no default. Write subject: …, or several as subjects: {name: …}."),
        ("subject:\n", "subject: empty; it must be a mapping"),
        ("subjects:\n", "subjects has no entry, and a shot needs a subject. Write one: "),
        ("subjects: {}\n", "subjects has no entry"),
        ("subject: {solid: box}\nsubjects: {a: {solid: box}}\n", "5:1: the shot has both subject and"),
        ("subjects: {a: {solid: box}, a: {solid: rod}}\n", "4:29: a is given twice, first in line 4"),
        ("subjects: {'a b': {solid: box}}\n", "'a b' cannot name a subject; a name begins with a letter"),
        ("subjects: {stage: {solid: box}}\n", "stage is the name of something else in pictures. Rename"),
        ("subjects: {a: box}\n", "subjects.a: 'box' is not a mapping"),
    ],
)
def test_a_wrong_set_of_subjects_has_one_message_with_its_place(entry: str, said: str) -> None:
    message = told(entry)
    assert said in message and message.startswith("a.yaml:") and len(message.splitlines()) == 1


ROOM = "copies: {count: 5, region: {sphere: {radius: 1}}}"


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ("look: clay", "subjects.a.solid: missing"),
        ("solid: box, loook: clay", "subjects.a.loook: unknown name. Did you mean 'look'?"),
        ("solid: box, size: [1, 1, 1], radius: 2", "4:45: radius is not a measure of a box."),
        ("model: box.obj, size: [1, 1, 1]", "subjects.a.size: unknown name. It is for solid, not for model."),
        (f"solid: box, {ROOM.replace('5', '0')}", "count: 0 is out of range; it must be at least 1"),
        (f"solid: box, {ROOM}", "4:28: the region has room for no copy of this subject"),
        (f"solid: box, {ROOM.replace('1}', '4}')}", "the region has room for 3 copies of this subject"),
        (f"solid: box, place: [1, 0, 0], {ROOM}", "place is for a subject without copies"),
        *shot_rows([(f"net: {{solid: tube}}, {ROOM}", "a net is one grid of points and has no copies")]),
        ("solid: box, copies: {count: 2, region: {half_space: {}}}", "half_space gives it none"),
        ("solid: box, look: symbolics_1990", "shows one subject. Take another look."),
        ("solid: sheet, look: glass", "4:30: look glass is for closed surfaces"),
        ("solid: box, flows: [{twist: {amount: {keys: {1: 0, x: 3}}}}]", "4:67: key 'x' is not a time"),
    ],
)
def test_a_mistake_in_a_subject_has_one_message_with_its_place(settings: str, said: str) -> None:
    message = told(f"subjects: {{a: {{{settings}}}}}\n")
    first, *others = message.splitlines()
    assert said in first and first.startswith("a.yaml:")
    assert all("box.obj is not there" in line for line in others)


def test_without_resampling_each_subject_is_asked_for_it() -> None:
    assert "resample: missing" in told("subjects: {a: {solid: box}}\n", rest="")


@needs_plugins("points")
def test_points_among_several_subjects_need_no_resampling() -> None:
    cloud = "{cloud: {solid: box}, radius: 0.1, count: 9}"
    text = f"title: T\nframes: 1-2\nsubjects: {{a: {{solid: box}}, b: {cloud}}}\n"
    a, b = read_shot("a.yaml", text + "resample: {max_edge_length: 0.5}\n").subjects
    assert a.motion.resampling is not None and b.motion.resampling is None


def test_a_shot_inherits_subjects_by_name_and_one_subject_takes_the_place_of_several(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(SHOT)
    child = tmp_path / "b.yaml"
    child.write_text("extends: a\nsubjects: {crane: {look: chrome}}\n")
    crane, heron = read_shot(child).subjects
    assert crane.picture.look.model == "metal" and crane.motion.place == (-1.0, 0.0, 0.0)
    assert heron.motion == shot_of().subjects[1].motion
    child.write_text("extends: a\nsubject: {solid: box}\n")
    assert read_shot(child).subjects == ()
    chosen = read_shot(tmp_path / "a.yaml", settings=["subjects.heron.flows.0.rotation.speed=45"])
    assert chosen.subjects[1].motion != heron.motion and chosen.subjects[0].motion == crane.motion
