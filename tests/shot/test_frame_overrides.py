"""Overrides of look, lights and quality for some frames of a shot: what they change, and what is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from flowsculpt.pipeline.errors import ShotError
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.request.render_request import RenderRequest
from flowsculpt.pipeline.shot import Shot, read_shot
from tests.conftest import QUALITY, ProjectFolder

NAME = "T010_tiny"
SHOT = "title: O\nframes: 1-96\nsubject: {solid: box}\nresample: off\nlight_groups: off\noverrides: [%s]\n"


def read(*overrides: str) -> Shot:
    return read_shot(Path("/nowhere/a.yaml"), SHOT % ", ".join(f"{{{each}}}" for each in overrides))


def test_the_frames_of_an_override_have_its_look_lights_and_quality_and_the_shots_exposure() -> None:
    override = "frames: 40-60, look: glaze, lights: gallery, quality: {final: {samples: 512, depth: 20}}"
    picture = read(override).picture
    (one,) = picture.overrides
    there = picture.overridden(one)
    assert one.frames.numbers == tuple(range(40, 61)) and one.is_seen
    assert there.look != picture.look and there.lights.names != picture.lights.names
    assert there.lights.exposure == picture.lights.exposure
    assert (there.qualities["final"].samples, there.qualities["final"].depth) == (512, 20)
    assert there.qualities["final"].fireflies == picture.qualities["final"].fireflies
    assert there.qualities["draft"] == picture.qualities["draft"]
    assert not read("frames: 7, quality: {daily: {samples: 128}}").picture.overrides[0].is_seen


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (("frames: 40-99, look: glaze",), "frames 97-99 are not in the shot, which has 1-96. Write frames"),
        (
            ("frames: 40-60, look: glaze", "frames: 50-70, lights: gallery"),
            "frames 50-60 are in overrides.0 too; a frame has one override. Take them out of one.",
        ),
        (("frames: 4-9",), "an override changes nothing without look, lights or quality"),
        (("look: glaze",), "overrides.0.frames: missing"),
        (("frames: four, look: glaze",), "four"),
        (("frames: 4-9, look: glazed",), "overrides.0.look: 'glazed' is not a look. Did you mean 'glaze'"),
        (
            ("frames: 4-9, lights: {rig: studio, exposure: 1}",),
            "exposure belongs to the display",
        ),
        (("frames: 4-9, quality: {final: {denoise: off}}",), "denoise belongs to the whole shot"),
        (
            ("frames: 4-9, look: speed",),
            "look speed shows measures of the motion",
        ),
        (("frames: 4-9, look: symbolics_1990",), "look symbolics_1990 is drawn without lights"),
        (("frames: 4-9, lights: {rig: studio, intensity: {kez: 2}}",), "kez is not a light here"),
        (
            ("frames: 4-9, quality: {draft: {samples: 8, noise_threshold: 0.05}}",),
            "takes 8 samples, too few to stop earlier",
        ),
        (("frames: 4-9, camera: {azimuth: 3}",), "camera"),
    ],
)
def test_what_an_override_cannot_say_is_refused_at_its_place(
    overrides: tuple[str, ...], message: str
) -> None:
    with pytest.raises(ShotError) as told:
        read(*overrides)
    assert message in str(told.value) and "a.yaml:6:" in str(told.value)
    assert len(str(told.value).splitlines()) == 1


def test_light_groups_need_the_same_lights_in_all_frames() -> None:
    text = (SHOT % "{frames: 4-9, lights: gallery}").replace("light_groups: off", "light_groups: each")
    with pytest.raises(ShotError, match="light_groups are layers that all frames have"):
        read_shot(Path("/nowhere/a.yaml"), text)


def keys_of(finished: ProjectFolder, override: str = "") -> tuple[dict, dict, RenderRequest]:
    """Return the keys of raw and finished frames of a shot with an override."""
    before = finished.shot.read_text()
    finished.shot.write_text(before + (f"overrides: [{{{override}}}]\n" if override else ""))
    project = Project(finished.path, cores=1)
    request = project.request(finished.shot, QUALITY)
    keys = request.keys.pictures(project.store)
    finished.shot.write_text(before)
    assert keys is not None, "a finished shot has cameras"
    return {n: keys[n].raw for n in keys}, {n: keys[n].frame for n in keys}, request


def test_only_frames_in_the_range_have_other_keys(finished: ProjectFolder) -> None:
    raw, frame, _ = keys_of(finished)
    for override in ("look: glaze", "lights: gallery", "quality: {draft: {depth: 3}}"):
        raw_there, frame_there, _ = keys_of(finished, f"frames: 3-4, {override}")
        assert [n for n in raw if raw[n] != raw_there[n]] == [3, 4]
        assert [n for n in frame if frame[n] != frame_there[n]] == [3, 4]
    assert keys_of(finished, "frames: 3-4, quality: {final: {depth: 3}}")[:2] == (raw, frame)


def test_frames_of_two_looks_are_not_averaged(finished: ProjectFolder) -> None:
    setting = "quality: {draft: {temporal_denoise: 2}}\n"
    finished.shot.write_text(finished.shot.read_text().replace("quality:", "intent:") + setting)
    _, _, request = keys_of(finished, "frames: 3-4, look: glaze")
    assert [request.pictures.window(n, lambda number: 1 <= number <= 6) for n in (1, 2, 3, 5)] == [
        (1, 2),
        (1, 2),
        (3, 4),
        (5, 6),
    ]
    _, _, plain = keys_of(finished, "frames: 3-4, quality: {draft: {depth: 3}}")
    assert plain.pictures.window(3, lambda number: 1 <= number <= 6) == (1, 2, 3, 4, 5)


def test_overridden_frames_are_rendered_as_they_say_and_the_others_kept(finished: ProjectFolder) -> None:
    before = {path.name: path.read_bytes() for path in finished.frames()}
    finished.shot.write_text(finished.shot.read_text() + "overrides: [{frames: 3, look: glaze}]\n")
    plan = finished.render()
    assert dict(plan.frame_counts())["render"] == 1
    after = {path.name: path.read_bytes() for path in finished.frames()}
    assert [name for name in before if before[name] != after[name]] == [f"{NAME}.0003.exr"]
