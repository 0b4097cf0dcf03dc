"""Finishing reads raw pictures from files and removes their noise as their headers say."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from flowsculpt.pipeline.errors import FrameError
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.store.paths import CHECKPOINTS
from flowsculpt.pipeline.production.store.store import Store
from flowsculpt.pipeline.production.tasks.finish import _made_by, _with_groups
from flowsculpt.pipeline.production.tasks.worker import do_job
from flowsculpt.render.post.denoise import Features, FilmDenoiser, denoise_light, denoiser_features
from flowsculpt.render.post.image import read_exr
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.scene_lights import groups_in
from tests.conftest import QUALITY, ProjectFolder


def finished_light(project: ProjectFolder) -> np.ndarray:
    (frame,) = project.frames()
    return read_exr(frame)[0]["beauty"]


def raw_picture(project: ProjectFolder) -> RenderedFrame:
    (raw,) = project.frames(kind="raw")
    return read_exr(raw)[0]


def unfiltered(raw: RenderedFrame, albedo: str = "albedo", normal: str = "normal") -> Features:
    return Features(raw[albedo], raw[normal])


def same(light: np.ndarray, expected: np.ndarray) -> bool:
    """Tell whether a finished file, in half floats, holds the expected light."""
    return np.array_equal(light, expected.astype(np.float16).astype(np.float32))


def test_light_groups_are_finished_without_layers_for_compositing(project: ProjectFolder) -> None:
    project.render("4", settings=("light_groups=each",))
    (frame,) = project.frames()
    finished = read_exr(frame)[0]
    groups = groups_in(finished.arrays)
    assert len(groups) > 1
    assert same(finished["beauty"], np.sum([*groups.values()], axis=0))


@pytest.mark.parametrize("shutter", ["0", "180"])
def test_features_without_noise_guide_the_denoiser_as_they_are(project: ProjectFolder, shutter: str) -> None:
    """A subject that stands still has none with an open shutter either."""
    project.render("4", settings=(f"shutter.angle={shutter}", "flows.0.twist.amount=0"))
    raw = raw_picture(project)
    assert "shutter" in raw.facts
    assert same(finished_light(project), denoise_light(raw["beauty"], unfiltered(raw), "balanced"))


@pytest.mark.parametrize(
    ("settings", "noisy"),
    [
        (("shutter.angle=360", "flows.0.twist.amount={keys: {1: 0, 6: 300}}"), {"motion_samples": 4}),
        (("camera.focal_length=85", "camera.aperture=1.4"), {"lens_radius": 0.1}),
        (("look=smoke",), {"features_apart": True}),
    ],
)
def test_features_with_noise_are_filtered_first(
    project: ProjectFolder, settings: tuple[str, ...], noisy: dict[str, float]
) -> None:
    project.render("4", settings=settings)
    raw, light = raw_picture(project), finished_light(project)
    filtered = denoiser_features(RenderedFrame(raw.arrays, noisy), "balanced")
    assert same(light, denoise_light(raw["beauty"], filtered, "balanced"))
    assert not same(light, denoise_light(raw["beauty"], unfiltered(raw), "balanced"))


@pytest.mark.parametrize("look", ["chrome", "glass"])
def test_what_mirrors_and_glass_show_is_filtered_first(project: ProjectFolder, look: str) -> None:
    project.render("1", settings=(f"look={look}",))
    raw, light = raw_picture(project), finished_light(project)
    filtered = denoiser_features(RenderedFrame(raw.arrays, {"motion_samples": 4}), "balanced")
    shown = unfiltered(raw, "denoise_albedo", "denoise_normal")
    assert same(light, denoise_light(raw["beauty"], filtered, "balanced"))
    assert not same(light, denoise_light(raw["beauty"], shown, "balanced"))


def test_a_picture_stage_that_changes_the_beauty_alone_changes_its_light_groups_alike() -> None:
    shape = (2, 3, 3)
    key, fill = np.full(shape, 0.25, np.float32), np.full(shape, 0.75, np.float32)
    key[0, 0] = fill[0, 0] = 0.0
    frame = RenderedFrame({"beauty": key + fill, "light_fill": fill, "light_key": key})
    darker = RenderedFrame({**frame.arrays, "beauty": 0.5 * frame["beauty"] + 0.1})
    groups = groups_in(_with_groups(darker, frame).arrays)
    assert np.allclose(sum(groups.values()), darker["beauty"])
    assert np.allclose(groups["key"][1], 0.25 * darker["beauty"][1])
    own = RenderedFrame({**darker.arrays, "light_key": 0.5 * key})
    assert _with_groups(own, frame) is own, "a stage that changes groups itself knows better"


def _colours_out(frame: RenderedFrame, *_: object) -> RenderedFrame:
    return RenderedFrame({**frame.arrays, "beauty": frame["beauty"][..., 0]}, frame.facts)


def _alpha_out(frame: RenderedFrame, *_: object) -> RenderedFrame:
    return RenderedFrame({"beauty": frame["beauty"]}, frame.facts)


def _raises(frame: RenderedFrame, *_: object) -> RenderedFrame:
    raise ValueError("no tint")


@pytest.mark.parametrize(
    ("task", "fault"),
    [
        (_colours_out, "layer beauty has the shape (2, 3), not (2, 3, 3)"),
        (_alpha_out, "layer alpha is missing; return all that the frame has"),
        (_raises, f"raised ValueError: no tint ({__file__}:{_raises.__code__.co_firstlineno + 1})"),
    ],
)
def test_a_picture_stage_that_breaks_its_contract_fails_the_frame_with_what_is_wrong(
    task: Callable[..., RenderedFrame], fault: str
) -> None:
    frame = RenderedFrame({"beauty": np.zeros((2, 3, 3), np.float32), "alpha": np.zeros((2, 3), np.float32)})
    with pytest.raises(FrameError) as raised:
        _made_by(task, "plug-in tints", frame, None, 7)
    assert str(raised.value).endswith(fault)


def test_batches_of_any_size_denoise_each_frame_once_and_give_the_same_files(
    project: ProjectFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where three batches need a frame, as those of two frames do that average five."""
    project.shot.write_text(f"{project.shot.read_text()}\nquality: {{draft: {{temporal_denoise: 2}}}}\n")
    project.render("1-6")
    whole = [frame.read_bytes() for frame in project.frames()]
    denoised, single = list[int](), FilmDenoiser._single_light
    monkeypatch.setattr(
        FilmDenoiser, "_single_light", lambda self, raw: (denoised.append(1), single(self, raw))[1]
    )
    monkeypatch.chdir(project.path)
    plan = Project(project.path, 1).whole([project.shot.stem], QUALITY)
    plan.write(project.path / "plan.json")
    finishing = next(job.name for job in plan.jobs if job.stage == "finish")
    store = Store(project.path)
    for batches in (("1-2", "3-4", "5-6"), ("5-6", "1", "2-4"), ("1-6",)):
        denoised.clear()
        keys = plan.requests[0].keys.pictures(store)
        assert keys is not None
        for key in map(keys.__getitem__, range(1, 7)):
            store.discard("frame", key.frame)
        for frames in batches:
            assert do_job("plan.json", f"{finishing}:{frames}", insist=True) == 0
        assert len(denoised) == 6, batches
        assert [frame.read_bytes() for frame in project.frames()] == whole
        assert not list((project.path / CHECKPOINTS).glob("*")), "light that no batch needs any more"
