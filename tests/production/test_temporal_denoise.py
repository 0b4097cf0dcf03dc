"""Noise taken out over time: which pictures a picture takes light from, and what that makes stale."""

from pathlib import Path

from render.post.image import read_exr, read_header

NAME = "T010_tiny"
STEADY = ("-q", "draft", "--set", "quality.draft={temporal_denoise: 2}")


def frame(project, number: int, kind: str = "frames") -> Path:
    return project.path / "renders" / NAME / "draft" / kind / f"{NAME}.{number:04d}.exr"


def test_every_picture_takes_light_from_those_around_it_and_none_is_stale_for_it(project):
    done = project.run("render", NAME, *STEADY)
    assert done.code == 0, done.err
    used = [read_header(frame(project, n))["temporal_neighbours"] for n in range(1, 7)]
    assert used == [[2, 3], [1, 3, 4], [1, 2, 4, 5], [2, 3, 5, 6], [3, 4, 6], [4, 5]]
    assert {"before", "after"} <= set(read_exr(frame(project, 3, "raw"))[0].arrays)
    before = read_exr(frame(project, 3))[0]
    assert set(before.arrays) == {"beauty", "alpha"}
    for place in (project.path / ".flowsculpt" / "store" / "frame").rglob("*.exr"):
        place.unlink()
    again = project.run("render", NAME, "-f", "3", *STEADY)
    assert again.code == 0 and "(0 frames rendered)" in again.out
    assert (read_exr(frame(project, 3))[0]["beauty"] == before["beauty"]).all()


def test_pictures_that_came_alone_take_in_what_comes_later(project):
    assert project.run("render", NAME, "-f", "3", *STEADY).code == 0
    assert "temporal_neighbours" not in read_header(frame(project, 3))
    whole = project.run("render", NAME, *STEADY)
    assert whole.code == 0 and "(5 frames rendered)" in whole.out
    assert read_header(frame(project, 3))["temporal_neighbours"] == [1, 2, 4, 5]


def test_it_is_off_where_noise_is_wanted(project):
    done = project.run("render", NAME, "-f", "2-3", *STEADY, "--set", "quality.draft.denoise=off")
    assert done.code == 0 and "temporal_neighbours" not in read_header(frame(project, 2))
    assert "before" not in read_exr(frame(project, 2, "raw"))[0].arrays
