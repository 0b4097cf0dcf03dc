"""Faults at night: workers that hang or are killed, full disks, clocks, runs killed repeatedly."""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flowsculpt.render.post.image import read_exr
from tests.conftest import QUALITY
from tests.needed_plugins import installed

NAME = "T010_tiny"
KILLS = 50
SIZE = ["-q", QUALITY]
WORDS = installed(["simulate", NAME], ["film", *SIZE], ["stills", NAME, *SIZE], ["publish", NAME, *SIZE])

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="looks at processes as Linux has them")


def same_pixels(one: Any, other: Any) -> bool:
    pairs = zip(one.frames(), other.frames(), strict=True)
    return all(np.array_equal(read_exr(a)[0]["beauty"], read_exr(b)[0]["beauty"]) for a, b in pairs)


def left_over(project: Any) -> list[Path]:
    state = project.path / ".flowsculpt"
    return [*project.path.rglob("*.tmp"), *(state / "tmp").glob("*"), *(state / "checkpoints").glob("*")]


@pytest.mark.soak
def test_a_worker_that_hangs_is_ended_and_its_frame_made_by_another(
    project: Any, finished_project: Any
) -> None:
    process = project.start("render", NAME, "-q", QUALITY, "--timeout", "0.5")
    project.wait_until(lambda: project.renderers(process))
    project.renderers(process)[0].suspend()
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, out + err
    assert same_pixels(project, finished_project) and not left_over(project)


@pytest.mark.soak
def test_a_worker_that_is_killed_for_its_memory_is_followed_by_fewer(
    project: Any, finished_project: Any
) -> None:
    process = project.start("render", NAME, "-q", QUALITY)
    project.wait_until(lambda: len(project.renderers(process)) == 2)
    project.renderers(process)[0].kill()
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, out + err
    assert same_pixels(project, finished_project) and not left_over(project)


def test_the_time_of_files_decides_nothing(finished: Any) -> None:
    """Hosts may disagree about the time, and clocks may be set back."""
    chance = random.Random(1)
    for path in finished.path.rglob("*.*"):
        when = time.time() + chance.uniform(-3e7, 3e7)
        os.utime(path, (when, when))
    assert finished.call("render", NAME, "-q", QUALITY).out.startswith("Nothing to be done")


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 64 MiB."""
    place = tmp_path / "small"
    place.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=64m", "tmpfs", str(place)], capture_output=True
    )
    if mounted.returncode:
        pytest.skip("file systems cannot be mounted here")
    yield place
    subprocess.run(["umount", str(place)], check=True)


@pytest.mark.soak
def test_a_full_disk_is_told_in_one_line_and_once_there_is_room_the_run_goes_on(
    project: Any, finished_project: Any, small_disk: Path
) -> None:
    ballast = small_disk / "ballast"
    ballast.write_bytes(bytes((64 << 20) - 65536))
    full = project.run("--root", str(small_disk), "render", NAME, "-q", QUALITY)
    assert full.code == 4 and "full" in full.err, full.out + full.err
    valid = sorted((small_disk / ".flowsculpt" / "store").rglob("*.npz"))
    ballast.unlink()
    done = project.run("--root", str(small_disk), "render", NAME, "-q", QUALITY)
    assert done.code == 0, done.err
    assert all(path.exists() for path in valid)
    (project.path / "renders").symlink_to(small_disk / "renders")
    assert same_pixels(project, finished_project)


@pytest.mark.soak
@pytest.mark.parametrize("left", [0, 24_576, 80_000, 300_000, 1_500_000])
@pytest.mark.parametrize("words", WORDS)
def test_wherever_a_run_fills_the_disk_one_line_says_so(
    words: list[str], left: int, finished: Any, small_disk: Path
) -> None:
    """The disk holds a finished project without the last results; `left` bytes are free."""
    root = finished.copy(small_disk / "show")
    kinds = ("mesh", "normals", "cameras") if words[0] == "simulate" else ("movie", "frame")
    for kind in kinds if words[0] != "publish" else ():
        shutil.rmtree(root.path / ".flowsculpt/store" / kind)
        shutil.rmtree(root.path / "renders", ignore_errors=True)
    ballast = small_disk / "ballast"
    ballast.write_bytes(bytes(max(0, shutil.disk_usage(small_disk).free - left)))
    full = root.run(*words)
    assert full.code == 0 or (full.code == 4 and "the disk is full" in full.err), full.out + full.err
    ballast.unlink()
    assert root.run(*words).code == 0 and not left_over(root)


@pytest.mark.soak
def test_a_plan_that_is_deleted_during_its_run_is_made_anew(project: Any, finished_project: Any) -> None:
    process = project.start("render", NAME, "-q", QUALITY)
    project.wait_until(lambda: project.frames(kind="raw"))
    for plan in (project.path / ".flowsculpt/plans").iterdir():
        plan.unlink()
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, out + err
    assert same_pixels(project, finished_project) and not left_over(project)


@pytest.mark.soak
def test_a_show_in_a_folder_of_any_name_in_one_line_is_rendered(
    tmp_path: Path, finished_project: Any
) -> None:
    project = finished_project.copy(tmp_path / 'it\'s "my" {show} [red] $HOME %d ü')
    forget_pictures(project)
    deliver = ["deliver", NAME, *SIZE, "--as", "review"]
    for words in installed(["film", *SIZE], ["review", NAME], deliver, ["verify"], ["status"]):
        done = project.run(*words)
        assert done.code == 0, done.err
    assert same_pixels(project, finished_project)


def forget_pictures(project: Any) -> None:
    """All that was rendered and cut, so that a run has something to do again; meshes stay."""
    for kind in ("raw", "frame", "movie"):
        shutil.rmtree(project.path / ".flowsculpt" / "store" / kind, ignore_errors=True)
    shutil.rmtree(project.path / "renders", ignore_errors=True)


@pytest.mark.soak
def test_a_film_killed_fifty_times_is_the_film_of_an_undisturbed_run(
    project: Any, finished_project: Any
) -> None:
    chance, kills = random.Random(KILLS), 0
    while kills < KILLS:
        process = project.start("film", "-q", QUALITY)
        try:
            out, err = process.communicate(timeout=chance.uniform(0.5, 14.0))
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
            kills += 1
        else:
            assert process.returncode == 0, out + err
            forget_pictures(project)
    done = project.run("film", "-q", QUALITY)
    assert done.code == 0, done.err
    assert same_pixels(project, finished_project) and not left_over(project)
