"""The store: whole files or none, found again by key, shown as links and copies."""

import os
import platform
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from flowsculpt.pipeline.errors import MachineError
from flowsculpt.pipeline.production.store.paths import SUFFIXES
from flowsculpt.pipeline.production.store.store import Store, sweep

pytestmark = pytest.mark.quick

KEY = "ab" * 16


@pytest.fixture
def store(tmp_path):
    return Store(tmp_path)


def fill(store, text="content", key=KEY):
    return store.put("cameras", key, lambda path: path.write_text(text))


def leftovers(store):
    folders = (store.scratch, store.inner_scratch)
    return [path for folder in folders if folder.exists() for path in folder.rglob("*")]


def test_what_is_put_is_held_and_cannot_be_written(store):
    path = fill(store)
    assert store.holds("cameras", KEY)
    assert path.read_text() == "content"
    assert not path.stat().st_mode & 0o222
    assert leftovers(store) == []


def test_a_key_is_written_once(store):
    fill(store, "first")
    assert fill(store, "second").read_text() == "first"


def test_a_writer_that_fails_leaves_nothing(store):
    def write(path: Path) -> None:
        path.write_text("half")
        raise RuntimeError("interrupted")

    with pytest.raises(RuntimeError):
        store.put("cameras", KEY, write)
    assert not store.holds("cameras", KEY)
    assert leftovers(store) == []


def test_a_link_shows_the_file_and_replaces_what_was_there(store):
    fill(store)
    target = Path("renders/a/a.cameras.json")
    (store.root / target).parent.mkdir(parents=True)
    (store.root / target).write_text("something else")
    assert not store.shows("cameras", KEY, target)
    store.link("cameras", KEY, target)
    assert store.shows("cameras", KEY, target)
    assert (store.root / target).read_text() == "content"


def test_another_version_is_not_taken_for_this_one(store):
    other = "cd" * 16
    fill(store), fill(store, "CONTENT", other)
    store.link("cameras", other, Path("shown.json"))
    times = store.path("cameras", other).stat()
    os.utime(store.path("cameras", KEY), ns=(times.st_atime_ns, times.st_mtime_ns))
    assert not store.shows("cameras", KEY, Path("shown.json"))


def test_where_links_cannot_be_made_copies_serve(store, monkeypatch):
    def refuse(*_: object) -> None:
        raise OSError(95, "Operation not supported")

    monkeypatch.setattr(os, "link", refuse)
    fill(store)
    store.link("cameras", KEY, Path("renders/copy.json"))
    assert store.shows("cameras", KEY, Path("renders/copy.json"))
    assert not store.path("cameras", KEY).samefile(store.root / "renders/copy.json")
    assert [p.name for p in (store.root / "renders").iterdir()] == ["copy.json"]


@pytest.mark.parametrize("kind", SUFFIXES)
def test_nobody_can_damage_the_store_by_writing_into_what_is_shown(store, kind):
    content = bytes(range(256)) * 1024
    stored = store.put(kind, KEY, lambda path: path.write_bytes(content))
    target = Path(f"renders/shown{SUFFIXES[kind]}")
    store.link(kind, KEY, target)
    shown = store.root / target
    assert store.shows(kind, KEY, target)
    assert not stored.stat().st_mode & 0o222
    if not shown.stat().st_mode & 0o222:
        assert shown.samefile(stored), "a link, which takes no space"
        return
    with shown.open("r+b") as file:
        file.seek(len(content) // 2)
        file.write(b"edited")
    assert stored.read_bytes() == content
    store.link(kind, KEY, target)
    assert shown.read_bytes() == content, "also where size and ends are the same"


def test_a_movie_that_an_earlier_version_linked_becomes_a_copy(store):
    stored = store.put("movie", KEY, lambda path: path.write_bytes(b"frames"))
    (store.root / "a.mp4").hardlink_to(stored)
    assert not store.shows("movie", KEY, Path("a.mp4"))
    store.link("movie", KEY, Path("a.mp4"))
    assert store.shows("movie", KEY, Path("a.mp4"))
    assert not stored.samefile(store.root / "a.mp4")


def test_where_the_disk_copies_no_blocks_movies_are_copied_all_the_same(store, monkeypatch):
    def refuse(*_: object) -> int:
        raise OSError(95, "Operation not supported")

    for copy in (refuse, lambda *_: 0):
        monkeypatch.setattr(os, "copy_file_range", copy)
        store.put("movie", KEY, lambda path: path.write_bytes(b"frames"))
        store.link("movie", KEY, Path("a.mp4"), replace=True)
        assert (store.root / "a.mp4").read_bytes() == b"frames"


def test_a_copy_is_known_whatever_the_clock_said(store):
    fill(store, "content" * 5000)
    copy = store.root / "copy.json"
    copy.write_bytes(store.path("cameras", KEY).read_bytes())
    for moment in (0, 4_000_000_000):
        os.utime(copy, (moment, moment))
        assert store.shows("cameras", KEY, Path("copy.json"))
    copy.write_bytes(copy.read_bytes()[:-1] + b"!")
    assert not store.shows("cameras", KEY, Path("copy.json"))


def test_a_disk_that_is_full_is_told_in_one_line_and_nothing_is_left(store):
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
    try:
        with pytest.raises(MachineError, match="larger than this process may write"):
            fill(store, "x" * 100_000)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert not store.holds("cameras", KEY)
    assert leftovers(store) == []


def test_sweeping_leaves_what_others_are_writing(store):
    store.scratch.mkdir(parents=True)
    here = platform.node()
    gone = subprocess.Popen(["true"])
    gone.wait()
    kept = [store.scratch / f"{here}+{os.getppid()}+a.exr", store.scratch / "node7+12+b.exr"]
    left = [store.scratch / f"{here}+{gone.pid}+c.exr", store.scratch / "node7+12+d.exr", store.draft(".exr")]
    for path in (*kept, *left):
        path.write_text("half a frame")
    os.utime(left[1], (0, 0))
    sweep(store)
    assert sorted(leftovers(store)) == sorted(kept)


def test_a_host_whose_clock_is_ahead_leaves_what_others_are_writing(store, monkeypatch):
    store.scratch.mkdir(parents=True)
    theirs = store.scratch / "node7+12+b.exr"
    theirs.write_text("half a frame")
    now = time.time()
    monkeypatch.setattr(time, "time", lambda: now + 30 * 24 * 3600)
    sweep(store)
    assert leftovers(store) == [theirs]


def test_sweeping_removes_what_a_killed_process_left(store):
    store.scratch.mkdir(parents=True)
    (store.scratch / "half.exr").write_text("half a frame")
    sweep(store)
    assert leftovers(store) == []


def test_what_a_killed_writer_left_beside_its_draft_goes_too(tmp_path):
    store = Store(tmp_path)
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    draft = store.draft(".exr")
    mine = f"{platform.node()}+{os.getpid()}+"
    assert draft.name.startswith(mine)
    theirs = draft.name.replace(mine, f"{platform.node()}+{ended.pid}+")
    draft.parent.mkdir(parents=True)
    (draft.parent / f".{theirs}.tmp{ended.pid}.exr").write_text("half")
    sweep(store)
    assert not any(draft.parent.iterdir())


def test_what_a_writer_killed_at_a_roots_state_leaves_is_swept_by_the_next_run(tmp_path):
    store = Store(tmp_path)
    done = tmp_path / ".flowsculpt/done/A/render/0001-0002.0123456789abcdef"
    script = """
import os, signal, sys
from pathlib import Path
from flowsculpt.pipeline.production.store.store import Store
from flowsculpt.render.base.atomic_write import atomic_write

Store(Path(sys.argv[1]))
with atomic_write(Path(sys.argv[2])) as draft:
    draft.write_text("half")
    os.kill(os.getpid(), signal.SIGKILL)
"""
    subprocess.run([sys.executable, "-c", script, str(tmp_path), str(done)], check=False)
    assert [path for path in tmp_path.rglob("*") if path.is_file()], "the killed writer leaves its draft"
    sweep(store)
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []
