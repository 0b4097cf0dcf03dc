"""Surfaces and lines from seeds as subjects of shots: what frames show, what decides them, and mistakes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flowsculpt import MissingInputError, validate
from flowsculpt.api import ShotError
from flowsculpt.pipeline.animation import MeshFrame, animate
from flowsculpt.pipeline.shot import read_shot

SHOT = """
title: Seeds
frames: 1-4
subject: {SUBJECT}
"""

LINE = "{line: [[-0.5, 0.1, 0.2], [0.5, 0.1, 0.2]]}"
SUBJECTS = {
    "streak_surface": f"streak_surface: {LINE}, velocity: [{{abc: {{}}}}]",
    "path_surface": f"path_surface: {LINE}, velocity: [{{abc: {{}}}}]",
    "stream_surface": f"stream_surface: {LINE}, velocity: [{{abc: {{}}}}], length: 0.5, direction: both",
    "streak_lines": f"streak_lines: {LINE}, velocity: [{{abc: {{}}}}], count: 4",
    "path_lines": f"path_lines: {LINE}, velocity: [{{abc: {{}}}}], count: 4",
    "stream_lines": f"stream_lines: {LINE}, velocity: [{{abc: {{}}}}], length: 0.5, direction: backwards",
}


def shot(subject: str, frames: str = "1-4", more: str = "") -> Any:
    text = SHOT.replace("SUBJECT", subject).replace("1-4", frames) + more
    return read_shot(Path("a.yaml"), text)


def frames_of(subject: str, frames: str = "1-4", only: frozenset[int] | None = None) -> list[MeshFrame]:
    return list(animate(shot(subject, frames), only=only))


def keys(subject: str, frames: str = "1-4") -> list[Any]:
    motion = shot(subject, frames).motion
    return [motion.animated.data(number) for number in motion.frames]


@pytest.mark.parametrize("word", SUBJECTS)
def test_every_frame_shows_what_has_been_released(word: str) -> None:
    meshes = [frame.mesh for frame in frames_of(SUBJECTS[word])]
    assert all(validate(mesh).problem is None for mesh in meshes)
    sizes = [float(np.linalg.norm(np.ptp(mesh.vertices, axis=0))) for mesh in meshes]
    if word.startswith("stream"):
        assert len(set(sizes)) == 1  # these velocities do not change
    else:
        assert sizes == sorted(sizes) and sizes[0] < sizes[-1]


@pytest.mark.parametrize("word", SUBJECTS)
def test_a_frame_alone_is_the_frame_of_the_whole_shot(word: str) -> None:
    (alone,) = frames_of(SUBJECTS[word], only=frozenset({3}))
    whole = frames_of(SUBJECTS[word])[2]
    assert np.array_equal(alone.mesh.vertices, whole.mesh.vertices)
    assert np.array_equal(alone.mesh.faces, whole.mesh.faces)


@pytest.mark.parametrize("word", SUBJECTS)
def test_keys_change_with_what_decides_a_frame_and_with_nothing_else(word: str) -> None:
    subject = SUBJECTS[word]
    before = keys(subject)
    assert keys(subject, "1-9")[:4] == before  # frames that are added later decide none
    assert keys(subject.replace("0.1, 0.2]]", "0.1, 0.3]]")) != before
    assert keys(subject.replace("abc: {}", "abc: {a: 2}")) != before
    assert keys(f"{subject}, max_edge_length: 0.2") != before
    if word.endswith("surface"):
        assert keys(f"{subject}, tolerance: 0.001") != before


def test_a_smaller_tolerance_makes_curved_parts_finer_and_lines_have_none() -> None:
    subject = SUBJECTS["stream_surface"] + ", max_edge_length: 0.1"
    plain, same, fine = (
        len(frames_of(subject + more, only=frozenset({1}))[0].mesh.vertices)
        for more in ("", ", tolerance: 0.000125", ", tolerance: 0.00001")
    )
    assert plain == same < 0.5 * fine
    with pytest.raises(ShotError, match="tolerance"):
        shot(SUBJECTS["stream_lines"] + ", tolerance: 0.001")


def test_an_edit_of_later_velocities_leaves_earlier_frames() -> None:
    moving = SUBJECTS["streak_surface"].replace("abc: {}", "abc: {a: {keys: {1: 1, 3: 1, 4: 2}}}")
    same = [
        one == other for one, other in zip(keys(moving), keys(moving.replace("4: 2", "4: 3")), strict=True)
    ]
    assert same == [True, True, True, False]


def test_patterns_go_by_place_along_the_seeds_and_time() -> None:
    frame = frames_of(SUBJECTS["path_surface"])[-1]
    along, _, time = frame.material.T
    assert np.isclose(along.min(), 0.0) and np.isclose(along.max(), 1.0)
    assert np.isclose(time.min(), 0.0) and time.max() > 0.1


def test_a_shell_has_the_thickness_of_the_shot() -> None:
    frame = frames_of(SUBJECTS["stream_surface"] + ", thickness: 0.02", only=frozenset({1}))[0]
    assert validate(frame.mesh).closed


@pytest.mark.parametrize(
    ("subject", "more", "message"),
    [
        (SUBJECTS["path_surface"] + ", paint: on", "", "paint is for models from files"),
        (SUBJECTS["path_surface"] + ", fit: 2", "", "fit is for models from files"),
        (SUBJECTS["path_surface"].replace("[0.5, 0.1, 0.2]", "[-0.5, 0.1, 0.2]"), "", "twice in a row"),
        (SUBJECTS["path_surface"].replace(LINE, "{circle: {normal: [0, 0, 0]}}"), "", "has no direction"),
        (SUBJECTS["path_surface"].replace(LINE, "{file: missing.txt}"), "", "missing.txt"),
        (SUBJECTS["path_surface"].replace("abc: {}", "twist: {amount: 1}"), "", "not a velocity field"),
        (
            SUBJECTS["path_surface"],
            "speed: {keys: {1: 1, 4: -2}}",
            "Keep speed above 0, or write stream_surface",
        ),
        (SUBJECTS["streak_lines"], "flows: [{abc: {}}]", "Leave flows out"),
        (SUBJECTS["streak_surface"] + ", begin: 0.5", "", "begin"),
        (SUBJECTS["streak_surface"] + ", tear: 0.5", "", "tear"),
    ],
)
def test_mistakes_are_named_with_their_place_and_remedy(subject: str, more: str, message: str) -> None:
    with pytest.raises((ShotError, MissingInputError), match=r"a\.yaml:[45]:") as caught:
        shot(subject, more=more)
    assert message in str(caught.value)


@pytest.mark.parametrize("text", ["", "1 2 3", "1 2\n3 4", "1 2 x\n3 4 5", "nan 0 0\n1 0 0"])
def test_a_file_of_seeds_is_read_right_or_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "seeds.txt").write_text(text)
    words = SHOT.replace("SUBJECT", SUBJECTS["path_lines"].replace(LINE, "{file: seeds.txt}"))
    with pytest.raises(ShotError, match=r"seeds\.txt: a curve of seeds is two or more lines of three"):
        read_shot(tmp_path / "a.yaml", words)
    (tmp_path / "seeds.txt").write_text("-0.5, 0.1, 0.2\n\n0.5 0.1 0.2\n")
    read = next(iter(animate(read_shot(tmp_path / "a.yaml", words))))
    line = next(iter(animate(shot(SUBJECTS["path_lines"]))))
    assert np.array_equal(read.mesh.vertices, line.mesh.vertices)


WITHIN = "within: {box: {centre: [0, 0.1, 0], size: [3, 0.2, 3]}}, max_edge_length: 0.05"
RISING = "velocity: [{translation: {rate: [0, 2, 0]}}]"


@pytest.mark.parametrize("word", ["path_surface", "streak_surface", "stream_surface", "path_lines"])
def test_what_leaves_a_region_ends_there(word: str) -> None:
    last = frames_of(f"{word}: {LINE}, {RISING}, {WITHIN}", "1-6")[-1].mesh
    assert validate(last).problem is None
    assert 0.2 < last.vertices[:, 1].max() < 0.26  # the border, and an edge in which points slow down


def test_a_falloff_of_a_region_says_over_what_distance_points_slow_down() -> None:
    wide = WITHIN.replace("}},", "}, falloff: 0.2},")
    (frame,) = frames_of(f"stream_surface: {LINE}, {RISING}, {wide}", "1-1")
    assert abs(frame.mesh.vertices[:, 1].max() - 0.3) < 0.02


def test_a_region_without_seeds_is_refused() -> None:
    with pytest.raises(ShotError, match="no seed is in the region"):
        shot(f"path_surface: {LINE}, {RISING}, within: {{sphere: {{centre: [9, 0, 0], radius: 1}}}}")


@pytest.mark.parametrize("setting", ["up: z", "repair: on", "paint: off", "fit: 2"])
def test_settings_of_files_are_refused(setting: str) -> None:
    with pytest.raises(ShotError, match="is for models from files"):
        shot(f"path_surface: {LINE}, {RISING}, {setting}")


def test_lines_stand_beside_other_subjects(tmp_path: Path) -> None:
    lines = "{path_lines: {line: [[-1, 0, 0], [1, 0, 0]]}, velocity: [{abc: {}}]}"
    ball = "{solid: icosphere, place: [3, 0, 0], resample: off}"
    text = f"title: Two\nframes: 1-2\nsubjects:\n  flow: {lines}\n  ball: {ball}\n"
    shot = read_shot(tmp_path / "a.yaml", text)
    assert [part.motion.animated is not None for part in shot.parts] == [True, False]


def test_another_look_makes_no_other_surface(tmp_path: Path) -> None:
    lines = "{path_lines: {line: [[-1, 0, 0], [1, 0, 0]]}, velocity: [{abc: {}}], values: speed, look: %s}"
    ball = "{solid: icosphere, place: [3, 0, 0], resample: off}"
    decided = []
    for look in ("clay", "{material: clay, measure: {values: {range: [0, 1]}}}"):
        text = f"title: Two\nframes: 1-2\nsubjects:\n  flow: {lines % look}\n  ball: {ball}\n"
        animated = read_shot(tmp_path / "a.yaml", text).parts[0].motion.animated
        assert animated is not None
        decided.append(animated.model.sequence.data(0.0))
    assert decided[0] == decided[1]


@pytest.mark.parametrize("kind", ["stream_lines", "path_lines", "streak_lines"])
def test_tapered_lines_are_thin_where_points_come_from(kind: str, tmp_path: Path) -> None:
    text = (
        f"title: T\nframes: 1-9\nsubject: {{{kind}: {{line: [[0, 0, -1], [0, 0, 1]]}}, count: 2, "
        "radius: 0.02, taper: 0.25, velocity: [{formula: [1, 0, 0]}], max_edge_length: 0.05}\n"
    )
    *_, last = animate(read_shot(tmp_path / "a.yaml", text))
    x, y = last.mesh.vertices[:, 0], last.mesh.vertices[:, 1]
    ends = [y[np.abs(x - end) < 0.1 * np.ptp(x)].max() for end in (x.min(), x.max())]
    assert ends[0] < 0.5 * ends[1] and ends[1] == pytest.approx(0.02, rel=0.1)
