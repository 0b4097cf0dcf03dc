"""Real runs: real Snakemake, real Mitsuba, a tiny shot."""

import json
import os
import signal
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest

from flowsculpt.render.movie.probe import probe_movie
from flowsculpt.render.post.image import read_exr, read_header
from tests.conftest import QUALITY
from tests.processes import HEARS_HANGUPS

NAME = "T010_tiny"
FILM = f"renders/film/{QUALITY}/film.mp4"


def facts(run):
    return json.loads(run.out)


def pixels(paths):
    return [read_exr(path)[0]["beauty"] for path in paths]


def test_the_film_holds_its_title_and_every_frame_of_its_shots(finished_project):
    movie = probe_movie(finished_project.path / FILM)
    assert movie.frames == 12 + 6
    assert (movie.width, movie.height) == (96, 54)
    assert (movie.primaries, movie.transfer, movie.matrix, movie.range) == (1, 1, 1, 1)


def test_pictures_show_the_sculpture_clear_of_the_edges(finished_project):
    for path in finished_project.frames(kind="raw"):
        matte = read_exr(path)[0]["matte"]
        assert matte.max() > 0.99
        border = np.concatenate(
            [matte[:2].ravel(), matte[-2:].ravel(), matte[:, :2].ravel(), matte[:, -2:].ravel()]
        )
        assert border.max() == 0


def test_a_frame_says_how_it_was_made(finished_project):
    header = read_header(finished_project.frames()[2])
    assert header["shot"] == NAME
    assert header["frame"] == 3
    assert header["max_edge_length"] == 0.5
    assert header["variant"] in ("llvm_ad_rgb", "scalar_rgb")
    assert set(header["camera"]) >= {"origin", "target", "field_of_view"}


def test_a_second_run_does_nothing_and_says_so(finished):
    before = (finished.path / FILM).stat().st_mtime_ns
    again = finished.call("film", "-q", QUALITY)
    assert again.code == 0
    assert again.out.startswith("Nothing to be done")
    assert (finished.path / FILM).stat().st_mtime_ns == before


def test_a_stepped_range_renders_just_its_frames(project):
    project.render("2-6x2")
    assert [path.name for path in project.frames()] == [f"{NAME}.{n:04d}.exr" for n in (2, 4, 6)]
    assert probe_movie(project.path / f"renders/{NAME}/{QUALITY}/{NAME}.2-6x2.mp4").frames == 3
    assert not (project.path / f"renders/{NAME}/{QUALITY}/{NAME}.mp4").exists()


def test_the_rest_of_a_shot_may_be_rendered_later_and_completes_its_movie(project):
    for part in ("1-2", "3-6"):
        project.render(part)
    assert probe_movie(project.path / f"renders/{NAME}/{QUALITY}/{NAME}.mp4").frames == 6


def test_a_shot_may_be_named_twice_and_shown_twice(finished):
    assert finished.run("render", NAME, NAME, "-f", "1-2", "-q", QUALITY).code == 0
    (finished.path / "shots/film.yaml").write_text(
        "title: Twice\nshots: [T010_tiny, T010_tiny]\ntitle_seconds: 0.25\ncredits_seconds: 0\n"
    )
    done = finished.run("film", "-q", QUALITY)
    assert done.code == 0, done.err
    assert probe_movie(finished.path / FILM).frames == 6 + 12


def test_two_shots_of_one_name_are_refused(project):
    (project.path / "other").mkdir()
    (project.path / "other" / f"{NAME}.yaml").write_text(project.shot.read_text())
    done = project.call("simulate", NAME, f"other/{NAME}.yaml")
    assert done.code == 2
    assert "both called" in done.err


KINDS = ("mesh", "normals", "cameras")


@pytest.mark.parametrize("kinds", [KINDS, *(pytest.param((kind,), marks=pytest.mark.soak) for kind in KINDS)])
def test_a_corrupt_file_on_the_way_is_made_again(finished, kinds):
    for kind in kinds:
        for stored in (finished.path / ".flowsculpt/store" / kind).rglob("*.*"):
            stored.chmod(0o644)
            os.truncate(stored, 300)
    finished.shot.write_text(finished.shot.read_text().replace("azimuth: -30", "azimuth: 10"))
    done = finished.run("render", NAME, "-f", "3", "-q", QUALITY)
    assert done.code == 0, done.err


def test_an_edit_during_a_run_waits_for_the_next(project):
    text = project.shot.read_text()
    process = project.start("render", NAME, "-q", QUALITY)
    project.wait_until(lambda: project.frames(kind="raw"))
    project.shot.write_text(text.replace("azimuth: -30", "azimuth: [broken"))
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, out + err
    project.shot.write_text(text)
    assert project.call("render", NAME, "-q", QUALITY).out.startswith("Nothing to be done")


def test_deleted_links_come_back_without_rendering(finished):
    for path in finished.frames()[1:4]:
        path.unlink()
    done = finished.call("--json", "render", NAME, "-q", QUALITY)
    assert facts(done)["made"] == {}
    assert facts(done)["links_restored"] == 3
    assert len(finished.frames()) == 6


def test_deleted_frames_are_rendered_again_those_alone_and_to_the_same_bits(finished):
    before = pixels(finished.frames())
    for number in (2, 5):
        header = read_header(finished.frames()[number - 1])
        for kind in ("frame", "raw"):
            folder = finished.path / ".flowsculpt/store" / kind
            key = (
                header["key"]
                if kind == "frame"
                else read_header(finished.frames(kind="raw")[number - 1])["key"]
            )
            (folder / key[:2] / f"{key}.exr").unlink()
    done = finished.run("--json", "render", NAME, "-q", QUALITY)
    assert facts(done)["made"] == {"render": 2, "finish": 2}
    for a, b in zip(before, pixels(finished.frames()), strict=True):
        assert np.array_equal(a, b)


def test_a_comment_changes_nothing(finished):
    finished.shot.write_text("# looks good\n" + finished.shot.read_text())
    assert finished.call("render", NAME, "-q", QUALITY).out.startswith("Nothing to be done")


def test_a_new_camera_renders_without_simulating_and_the_old_one_costs_nothing(finished):
    text = finished.shot.read_text()
    finished.shot.write_text(text.replace("azimuth: -30", "azimuth: 20"))
    made = facts(finished.run("--json", "render", NAME, "-f", "1-2", "-q", QUALITY))["made"]
    assert "simulate" not in made
    assert made["render"] == 2
    finished.shot.write_text(text)
    assert facts(finished.call("--json", "render", NAME, "-q", QUALITY))["made"] == {}


def test_an_edit_in_the_middle_simulates_from_there(finished):
    text = finished.shot.read_text()
    finished.shot.write_text(text.replace("6: 60}", "6: 90}"))
    made = facts(finished.run("--json", "simulate", NAME))["made"]
    assert made == {"simulate": 2}


def test_a_truncated_picture_is_found_before_assembly_and_made_again(finished):
    header = read_header(finished.frames()[3])
    stored = finished.path / ".flowsculpt/store/frame" / header["key"][:2] / f"{header['key']}.exr"
    stored.chmod(0o644)
    os.truncate(stored, 2000)
    (finished.path / "shots/film.yaml").write_text(
        "title: Other\nshots: [T010_tiny]\ntitle_seconds: 0.25\ncredits_seconds: 0\n"
    )
    done = finished.run("--json", "film", "-q", QUALITY)
    assert done.code == 0, done.err
    assert facts(done)["made"]["finish"] == 1
    assert probe_movie(finished.path / FILM).frames == 6 + 6


def lengthen(project):
    """Give the shot so many frames that its run is under way for many seconds, whatever stalls the test."""
    project.shot.write_text(project.shot.read_text().replace("frames: 1-6", "frames: 1-100"))


def processes_of(group):
    """Return the numbers of the processes of a group."""

    def belongs(folder):
        try:
            return (
                os.getpgid(int(folder.name)) == group and "\nState:\tZ" not in (folder / "status").read_text()
            )
        except (OSError, ProcessLookupError):
            return False

    return [int(folder.name) for folder in Path("/proc").glob("[0-9]*") if belongs(folder)]


def has_begun(project):
    """Tell whether a job of a run has begun."""
    logs = (project.path / ".flowsculpt/events").glob("*.jsonl")
    return any('"event": "begin"' in log.read_text() for log in logs)


def test_a_killed_run_goes_on_without_a_manual_step_to_the_same_pixels(project, finished_project):
    process = project.start(
        "render", NAME, "-q", QUALITY, at_raw=(2, "os.killpg(os.getpgid(0), signal.SIGKILL)")
    )
    process.communicate(timeout=300)
    assert process.returncode == -signal.SIGKILL and project.frames(kind="raw")
    assert not (project.path / f"renders/{NAME}/{QUALITY}/{NAME}.mp4").exists(), "it was not yet done"
    done = project.run("render", NAME, "-q", QUALITY)
    assert done.code == 0, done.err
    for a, b in zip(pixels(finished_project.frames()), pixels(project.frames()), strict=True):
        assert np.array_equal(a, b)
    assert [p for p in project.path.rglob("*") if ".tmp" in p.name or ".partial" in p.name] == []


def test_an_interrupted_run_ends_with_130_and_keeps_what_is_done(project):
    process = project.start(
        "render", NAME, "-q", QUALITY, at_raw=(2, "os.killpg(os.getpgid(0), signal.SIGINT)")
    )
    _, words = process.communicate(timeout=300)
    assert process.returncode == 130, words
    assert project.frames(kind="raw")
    assert "interrupted" in words
    assert "Traceback" not in words


@pytest.mark.parametrize(
    "signals",
    [
        [signal.SIGTERM],
        pytest.param([signal.SIGHUP], marks=HEARS_HANGUPS),
        [signal.SIGINT, signal.SIGINT, signal.SIGTERM],
    ],
)
def test_signals_to_the_command_alone_end_all_of_its_processes(project, signals):
    lengthen(project)
    process = project.start("render", NAME, "-q", QUALITY)
    project.wait_until(lambda: has_begun(project))
    for number in signals:
        process.send_signal(number)
        time.sleep(0.1)
    _, words = process.communicate(timeout=300)
    assert process.returncode == 130 and words.count("\n") == 1, words
    project.wait_until(lambda: not processes_of(process.pid))


def test_the_jobs_of_a_killed_command_do_not_outlive_it(project):
    lengthen(project)
    process = project.start("render", NAME, "-q", QUALITY)
    project.wait_until(lambda: has_begun(project))
    process.kill()
    process.communicate()
    project.wait_until(lambda: not processes_of(process.pid))


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no pool of workers")
@pytest.mark.parametrize("depth", [2, *(pytest.param(depth, marks=pytest.mark.soak) for depth in (1, 3))])
def test_a_run_goes_on_when_snakemake_the_pool_or_a_renderer_is_killed(project, depth):
    process = project.start("render", NAME, "-q", QUALITY)
    project.wait_until(lambda: project.frames(kind="raw"))
    killed = psutil.Process(process.pid)
    for _ in range(depth):
        killed = killed.children()[0]
    killed.kill()
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, out + err
    assert len(project.frames()) == 6


def test_a_second_run_of_the_same_is_refused_in_one_line_that_names_the_first(project):
    lengthen(project)
    process = project.start("render", NAME, "-q", QUALITY)
    try:
        project.wait_until(lambda: (project.path / ".flowsculpt/events").exists())
        other = project.call("render", NAME, "-q", QUALITY)
        assert other.code == 4 and other.err.count("\n") == 1
        assert f"{NAME} at {QUALITY}: another flowsculpt run" in other.err
        assert f"process {process.pid}, since 20" in other.err
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


def test_where_a_renderer_crashes_its_shot_starts_again_on_the_next(project):
    if "llvm_ad_rgb" not in project.call("doctor").out:
        pytest.skip("there is only one variant here to choose from")
    words = ("render", NAME, "-f", "1-4", "-q", QUALITY, "--set", "quality.draft.denoise=off")
    process = project.start(*words, at_raw=(2, "os.kill(os.getpid(), signal.SIGABRT)"))
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, out + err
    variants = {read_header(path)["variant"] for path in project.frames()}
    assert variants == {"scalar_rgb"}


def test_a_flow_that_explodes_stops_its_shot_and_keeps_the_frames_before(project):
    project.shot.write_text(
        project.shot.read_text()
        .replace("max_edge_length: 0.5", "max_edge_length: 0.5, max_vertices: 3000")
        .replace(
            "- twist:", "- stretch: {axis: x, amount: {ease: linear, keys: {1: 1, 6: 4000}}}\n  - twist:"
        )
    )
    done = project.run("simulate", NAME)
    assert done.code == 1
    assert "frame" in done.err and "3000" in done.err
    assert (project.path / f"renders/{NAME}/meshes/{NAME}.0001.npz").exists()


def test_a_folder_that_cannot_be_written_is_told_in_one_line(project):
    done = project.call("--root", "/sys", "simulate", NAME)
    assert done.code == 4
    assert done.err.count("\n") == 1
    assert "--root" in done.err
