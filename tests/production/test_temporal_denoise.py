"""Noise taken out over time: which pictures a picture takes light from, and what that makes stale."""

from pathlib import Path

from flowsculpt.render.post.image import read_exr, read_header
from tests.conftest import QUALITY

NAME = "T010_tiny"
STEADY = ("quality.draft={temporal_denoise: 2}",)


def frame(project, number: int, kind: str = "frames") -> Path:
    return project.path / "renders" / NAME / QUALITY / kind / f"{NAME}.{number:04d}.exr"


def rendered(plan) -> set[int]:
    return {number for job in plan.jobs if job.stage == "render" for number in job.frames}


def test_every_picture_takes_light_from_those_around_it_and_none_is_stale_for_it(project):
    project.render(settings=STEADY)
    used = [read_header(frame(project, n))["temporal_neighbours"] for n in range(1, 7)]
    assert used == [[2, 3], [1, 3, 4], [1, 2, 4, 5], [2, 3, 5, 6], [3, 4, 6], [4, 5]]
    assert {"before", "after"} <= set(read_exr(frame(project, 3, "raw"))[0].arrays)
    before = read_exr(frame(project, 3))[0]
    assert set(before.arrays) == {"beauty", "alpha"}
    for place in (project.path / ".flowsculpt" / "store" / "frame").rglob("*.exr"):
        place.unlink()
    again = project.render("3", settings=STEADY)
    assert again.jobs and not rendered(again)
    assert (read_exr(frame(project, 3))[0]["beauty"] == before["beauty"]).all()


def test_pictures_that_came_alone_take_in_what_comes_later(project):
    project.render("3", settings=STEADY)
    assert "temporal_neighbours" not in read_header(frame(project, 3))
    words = ("render", NAME, "-q", QUALITY, *(word for setting in STEADY for word in ("--set", setting)))
    whole = project.run(*words)
    assert whole.code == 0 and "(5 frames rendered)" in whole.out, whole.err
    assert read_header(frame(project, 3))["temporal_neighbours"] == [1, 2, 4, 5]


def test_it_is_off_where_noise_is_wanted(project):
    project.render("2-3", settings=(*STEADY, "quality.draft.denoise=off"))
    assert "temporal_neighbours" not in read_header(frame(project, 2))
    assert "before" not in read_exr(frame(project, 2, "raw"))[0].arrays
