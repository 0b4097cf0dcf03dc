"""A store on another disk than its root: by a link, or as a disk of its own."""

from __future__ import annotations

import shlex
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from flowsculpt.pipeline.production.store.store import Store
from tests.conftest import QUALITY, ProjectFolder
from tests.needed_plugins import needs_plugins

NAME = "T010_tiny"

DISK = Path("/dev/shm")


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    """A folder on a disk of its own."""
    if not DISK.is_dir() or DISK.stat().st_dev == tmp_path.stat().st_dev:
        pytest.skip("there is no second disk here")
    with TemporaryDirectory(dir=DISK) as folder:
        yield Path(folder) / "a show's store"


@pytest.fixture
def moved(finished: ProjectFolder, disk: Path) -> ProjectFolder:
    """A finished project whose store was moved, by the two lines that the docs show."""
    store = finished.path / ".flowsculpt/store"
    shutil.move(store, disk)
    store.symlink_to(disk)
    return finished


@needs_plugins("maintenance")
def test_a_store_that_was_moved_is_whole_and_what_renders_shows_becomes_links(
    moved: ProjectFolder, disk: Path
) -> None:
    assert moved.call("render", NAME, "-q", QUALITY).out.startswith("Nothing to be done")
    assert not any(frame.is_symlink() for frame in moved.frames()), "copies, on the small disk"
    done = moved.call("clean")
    assert done.code == 0 and "in renders/ became links to the store" in done.out
    frames = moved.frames()
    assert len(frames) == 6 and all(frame.resolve().is_relative_to(disk) for frame in frames)
    assert not any(Path(frame.readlink()).is_absolute() for frame in frames), "a show may be moved"
    verified = moved.call("verify")
    assert verified.code == 0, verified.out + verified.err
    assert moved.call("film", "-q", QUALITY).out.startswith("Nothing to be done")


@needs_plugins("maintenance")
def test_frames_are_made_damaged_and_made_again_across_disks(moved: ProjectFolder, disk: Path) -> None:
    moved.call("clean")
    shutil.rmtree(disk / "frame")
    moved.render("1-3")
    first, second, *_ = moved.frames()
    assert first.resolve().is_relative_to(disk)
    stored = first.resolve()
    stored.chmod(0o644)
    stored.write_bytes(stored.read_bytes()[:-100])
    assert moved.call("verify").code == 0, "it makes the frame again"
    store = Store(moved.path)
    assert first.resolve() == stored and store.digests.check(store.path("frame", stored.stem))
    assert second.resolve().is_file()


def test_a_new_store_on_another_disk_is_used_once_it_says_whose_it_is(
    project: ProjectFolder, disk: Path
) -> None:
    disk.mkdir()
    state = project.path / ".flowsculpt"
    state.mkdir()
    (state / "store").symlink_to(disk)
    refused = project.call("render", NAME, "-q", QUALITY, "-f", "1-2")
    assert refused.code == 4 and "a link to" in refused.err and not [*disk.iterdir()]
    remedy = refused.err.partition("if it is this show's store, run: ")[2]
    assert subprocess.run(shlex.split(remedy), check=False).returncode == 0
    done = project.run("render", NAME, "-q", QUALITY, "-f", "1-2")
    assert done.code == 0, done.err
    assert all(frame.resolve().is_relative_to(disk) for frame in project.frames())
    assert not [*Store(project.path).scratch.glob("*"), *Store(project.path).inner_scratch.glob("*")]


@needs_plugins("versions")
def test_a_published_version_holds_its_files_whatever_becomes_of_the_store(
    moved: ProjectFolder, disk: Path
) -> None:
    done = moved.call("publish", NAME, "-q", QUALITY)
    assert done.code == 0, done.err
    shutil.rmtree(disk)
    frames = [*(moved.path / "renders/published" / NAME).rglob("*.exr")]
    assert len(frames) == 6 and not any(frame.is_symlink() for frame in frames)


@needs_plugins("maintenance")
def test_a_store_whose_disk_is_not_mounted_is_named_and_nothing_counts_as_missing(
    project: ProjectFolder, tmp_path: Path
) -> None:
    (project.path / ".flowsculpt").mkdir()
    (project.path / ".flowsculpt/store").symlink_to(tmp_path / "absent")
    for words in (["status"], ["render", NAME, "--dry-run"]):
        told = project.call(*words)
        assert told.code == 4 and "absent, which is not a folder; mount its disk" in told.err
