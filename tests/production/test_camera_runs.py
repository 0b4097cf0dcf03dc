"""Real runs of cameras and of parts of pictures."""

import re

from flowsculpt.render.movie.probe import probe_movie
from flowsculpt.render.post.image import read_exr, read_header
from tests.conftest import QUALITY

NAME = "T010_tiny"


def test_a_part_of_a_smaller_picture_has_a_folder_of_its_own(project):
    part = ("--scale", "50%", "--crop", "0.25,0.25,0.75,0.75")
    done = project.run("render", NAME, "-f", "2", "-q", "draft", *part)
    assert done.code == 0, done.err
    quality = "draft.scale50.crop60-33-180-102"
    frames = project.frames(quality)
    assert [path.name for path in frames] == [f"{NAME}.0002.exr"]
    assert read_exr(frames[0])[0].size == (120, 69)
    assert read_header(frames[0])["quality"] == quality
    assert probe_movie(project.path / f"renders/{NAME}/{quality}/{NAME}.2.mp4").frames == 1
    assert not project.frames()
    whole = project.render("2")
    assert {job.stage for job in whole.jobs} >= {"render", "finish"}
    assert not any(job.stage == "frame_camera" for job in whole.jobs), "whole pictures have the same cameras"
    assert project.call("render", NAME, "-f", "2", "-q", "draft", *part).out.startswith("Nothing to be done")


def test_a_part_without_size_is_told_in_a_line(project):
    done = project.call("render", NAME, "--crop", "10,10,10,50")
    assert done.code == 2
    assert "is 0 × 40 pixels large" in done.err and len(done.err.strip().splitlines()) == 1


def test_a_frame_whose_camera_is_inside_fails_and_the_others_are_made(project):
    text = project.shot.read_text()
    way = "position: {ease: linear, keys: {1: [0, 0.5, 6], 2: [0, 0.5, 4], 3: [0.1, 0, 0.1]}}"
    project.shot.write_text(re.sub("camera: .*", f"camera: {{{way}}}", text))
    done = project.run("render", NAME, "-f", "1-3", "-q", QUALITY)
    assert done.code == 1
    assert done.err.count("frame 3: the camera is inside the sculpture, at 0.1, 0, 0.1") == 1
    assert [path.name for path in project.frames()] == [f"{NAME}.{n:04d}.exr" for n in (1, 2)]


def test_layers_for_compositing_are_written_without_rendering_again(project):
    once = ("render", NAME, "-f", "2", "-q", "draft", "--scale", "25%", "--crop", "0.25,0.25,0.75,0.75")
    unknown = project.call(*once, "--layers", "nuk")
    assert unknown.code == 2 and "Did you mean 'nuke'?" in unknown.err
    assert len(unknown.err.strip().splitlines()) == 1
    assert project.run(*once, "--layers", "nuke").code == 0
    frame = project.frames("draft.scale25.crop30-17-90-51")[0]
    layers = read_exr(frame)[0]
    assert layers.size == (60, 34) and {"alpha", "planar_depth", "motion", "CryptoObject00"} <= set(
        layers.arrays
    )
    again = project.run("--json", *once, "--layers", "blender")
    assert again.code == 0 and '"finish": 1' in again.out and '"render": 1' not in again.out
    assert read_exr(frame)[0].arrays.keys() == layers.arrays.keys()
    assert (read_exr(frame)[0]["beauty"] == layers["beauty"]).all()
