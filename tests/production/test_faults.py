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
import psutil
import pytest

from render.post.image import read_exr

NAME = "T010_tiny"
KILLS = 50

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="looks at processes as Linux has them")


def renderers(process: subprocess.Popen[str]) -> list[psutil.Process]:
    try:
        family = psutil.Process(process.pid).children(recursive=True)
        return [each for each in family if "--child" in each.cmdline()]
    except psutil.NoSuchProcess:
        return []


def loaded_renderers(process: subprocess.Popen[str]) -> list[psutil.Process]:
    """The processes that have loaded Mitsuba; the ones above stand for these where a server forks them."""
    try:
        family = psutil.Process(process.pid).children(recursive=True)
        return [each for each in family if any("mitsuba" in file.path for file in each.memory_maps())]
    except psutil.Error:
        return []


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
    process = project.start("render", NAME, "-q", "draft", "--timeout", "0.5")
    project.wait_until(lambda: loaded_renderers(process))
    loaded_renderers(process)[0].suspend()
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, out + err
    assert same_pixels(project, finished_project) and not left_over(project)


@pytest.mark.soak
def test_a_worker_that_is_killed_for_its_memory_is_followed_by_fewer(
    project: Any, finished_project: Any
) -> None:
    process = project.start("render", NAME, "-q", "draft")
    project.wait_until(lambda: len(renderers(process)) == 2)
    renderers(process)[0].kill()
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, out + err
    assert same_pixels(project, finished_project) and not left_over(project)


def test_the_time_of_files_decides_nothing(finished: Any) -> None:
    """Hosts may disagree about the time, and clocks may be set back."""
    chance = random.Random(1)
    for path in finished.path.rglob("*.*"):
        when = time.time() + chance.uniform(-3e7, 3e7)
        os.utime(path, (when, when))
    assert finished.run("render", NAME, "-q", "draft").out.startswith("Nothing to be done")


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 40 MiB."""
    place = tmp_path / "small"
    place.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=40m", "tmpfs", str(place)], capture_output=True
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
    ballast.write_bytes(bytes((40 << 20) - 65536))
    full = project.run("--root", str(small_disk), "render", NAME, "-q", "draft")
    assert full.code == 4 and "full" in full.err, full.out + full.err
    valid = sorted((small_disk / ".flowsculpt" / "store").rglob("*.npz"))
    ballast.unlink()
    done = project.run("--root", str(small_disk), "render", NAME, "-q", "draft")
    assert done.code == 0, done.err
    assert all(path.exists() for path in valid)
    (project.path / "renders").symlink_to(small_disk / "renders")
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
        process = project.start("film", "-q", "draft")
        try:
            out, err = process.communicate(timeout=chance.uniform(0.5, 14.0))
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
            kills += 1
        else:
            assert process.returncode == 0, out + err
            forget_pictures(project)
    done = project.run("film", "-q", "draft")
    assert done.code == 0, done.err
    assert same_pixels(project, finished_project) and not left_over(project)
