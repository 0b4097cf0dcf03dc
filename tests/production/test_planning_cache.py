"""The planning cache holds what reading a shot would find, or nothing."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import pytest

import flowsculpt.pipeline.shot
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.request import shot_source
from flowsculpt.pipeline.production.request.manifest import ShotManifest, input_digests
from flowsculpt.pipeline.production.request.render_request import RenderRequest
from flowsculpt.pipeline.production.request.shot_source import (
    NO_CACHE,
    PlanningCache,
    ShotSource,
)
from flowsculpt.render.base import user_cache
from flowsculpt.render.base.input_files import InputFile
from flowsculpt.render.base.serialise import from_plain, to_plain

pytestmark = pytest.mark.quick

SHOT = """\
title: T
frames: 1-5
subject: {model: wedge.obj}
resample: {max_edge_length: 0.5, hard_angle: {keys: {1: 30, 5: 60}}}
flows:
  - twist: {axis: y, amount: {keys: {1: 0, 5: 60}}}
shutter: {angle: 180}
"""
WEDGE = "v 0 0 0\nv 2 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A root that a run has begun in: others stay as they are."""
    (tmp_path / ".flowsculpt").mkdir()
    return tmp_path


@pytest.fixture(autouse=True)
def cache_folder(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's cache folder, with nothing in it."""
    folder = tmp_path_factory.mktemp("cache")
    monkeypatch.setattr(shot_source, "writable_cache", lambda: folder)
    shot_source._pruned_user_folder.cache_clear()
    return folder


@pytest.fixture
def shot(root: Path) -> Path:
    (root / "a.yaml").write_text(SHOT)
    (root / "wedge.obj").write_text(WEDGE)
    return root / "a.yaml"


def take_of(shot: Path, quality: str = "draft") -> RenderRequest:
    return Project(shot.parent, 2).request(shot, quality, variant="none")


def keys_of(request: RenderRequest) -> list[object]:
    frames = range(1, 6)
    told = [(request.keys.mesh(n), request.keys.normals(n), request.pictures.follows_flow(n)) for n in frames]
    return [
        told,
        request.keys.cameras,
        request.pictures.reach,
        request.keys.movie([]),
        request.keys.still("png", "0"),
    ]


def never(*arguments: object) -> None:
    raise AssertionError("the shot was read")


def forgetful(request: RenderRequest) -> RenderRequest:
    return replace(request, source=replace(request.source, cache=NO_CACHE))


@pytest.mark.parametrize("quality", ["draft", "final"])
def test_what_is_remembered_is_what_reading_the_shot_finds(
    shot: Path, quality: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, read = keys_of(take_of(shot, quality)), forgetful(take_of(shot, quality))
    assert keys_of(read) == first
    assert read.pictures.quality == read.shot.picture.qualities[quality]
    monkeypatch.setattr("flowsculpt.pipeline.shot.shot_reader.read_shot", never)
    assert keys_of(take_of(shot, quality)) == first


def test_an_edit_of_the_shot_or_of_a_file_that_it_reads_is_seen(shot: Path) -> None:
    keys = [keys_of(take_of(shot))]
    shot.write_text(SHOT.replace("5: 60}}}", "5: 70}}}"))
    keys.append(keys_of(take_of(shot)))
    (shot.parent / "wedge.obj").write_text(WEDGE.replace("v 2 0 0", "v 3 0 0"))
    keys.append(keys_of(take_of(shot)))
    assert keys[0] != keys[1] != keys[2] != keys[0]
    (shot.parent / "wedge.obj").write_text(WEDGE)
    shot.write_text(SHOT)
    assert keys_of(take_of(shot)) == keys[0]


def test_a_file_that_comes_to_lie_beside_those_that_were_read_has_the_shot_read_again(shot: Path) -> None:
    summary = from_plain(ShotManifest, to_plain(take_of(shot).source.manifest))
    assert summary.is_current
    (shot.parent / "wedge2.obj").write_text(WEDGE)
    assert not summary.is_current


def test_other_code_knows_nothing_of_it(shot: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    book = PlanningCache(shot.parent)
    book.put({"a": 1}, "of this")
    assert book.get(dict, "of this") == {"a": 1}
    assert book.get(dict, "of that") is None
    monkeypatch.setattr(shot_source, "_code", lambda: ["other"])
    assert book.get(dict, "of this") is None


def entry_of(text: str) -> bytes:
    """Return an entry with a valid digest, as another program may write it."""
    return f"{hashlib.sha256(text.encode()).hexdigest()}\n{text}".encode()


@pytest.mark.parametrize(
    "damage",
    [
        b"",
        b"\xff",
        b"{}",
        b"0\n{}",
        entry_of("{"),
        entry_of("[]"),
        entry_of("{}"),
        entry_of('{"of": "others"}'),
    ],
)
@pytest.mark.parametrize("has_begun", [True, False])
def test_an_entry_that_is_damaged_or_of_another_form_counts_as_none_and_is_written_again(
    shot: Path, cache_folder: Path, damage: bytes, has_begun: bool
) -> None:
    if not has_begun:
        (shot.parent / ".flowsculpt").rmdir()
    keys = keys_of(take_of(shot))
    folder = shot.parent / ".flowsculpt/planning" if has_begun else cache_folder / "planning"
    entries = {entry: entry.read_bytes() for entry in folder.glob("*.json")}
    assert len(entries) == 3  # of the shot, of its surfaces and of the request
    for entry in entries:
        entry.write_bytes(damage)
    assert keys_of(take_of(shot)) == keys
    assert {entry: entry.read_bytes() for entry in folder.glob("*.json")} == entries


def test_before_a_run_has_begun_planning_is_remembered_and_the_root_stays_as_it_is(
    shot: Path, cache_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (shot.parent / ".flowsculpt").rmdir()
    files = set(shot.parent.iterdir())
    keys = keys_of(take_of(shot))
    assert set(shot.parent.iterdir()) == files
    monkeypatch.setattr("flowsculpt.pipeline.shot.shot_reader.read_shot", never)
    assert keys_of(take_of(shot)) == keys
    (shot.parent / ".flowsculpt").mkdir()
    assert keys_of(take_of(shot)) == keys, "a run that begins goes on from there"


def test_a_home_that_cannot_be_written_hinders_nothing(
    shot: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    (shot.parent / ".flowsculpt").rmdir()
    home = tmp_path_factory.mktemp("home")
    (home / "file").write_text("")
    monkeypatch.setattr(shot_source, "writable_cache", user_cache.writable_cache)
    monkeypatch.setenv("XDG_CACHE_HOME", str(home / "file"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path_factory.mktemp("temporary")))
    keys = keys_of(take_of(shot))
    monkeypatch.setattr("flowsculpt.pipeline.shot.shot_reader.read_shot", never)
    assert keys_of(take_of(shot)) == keys, "it is remembered among temporary files"


WRITE_MANY = """
import sys
from pathlib import Path
from flowsculpt.pipeline.production.request import shot_source
shot_source.writable_cache = lambda: Path(sys.argv[1])
cache = shot_source.PlanningCache(Path(sys.argv[1], "root"))
for number in range(200):
    cache.put({"number": number}, number % 20, sys.argv[2] if number % 2 else "of both")
"""


def test_two_processes_at_once_lose_nothing(tmp_path: Path, cache_folder: Path) -> None:
    command = [sys.executable, "-c", WRITE_MANY, str(cache_folder)]
    processes = [subprocess.Popen([*command, name]) for name in ("one", "other")]
    assert [process.wait() for process in processes] == [0, 0]
    cache = PlanningCache(cache_folder / "root")
    for number in range(180, 200):
        names = ("one", "other") if number % 2 else ("of both",)
        assert [cache.get(dict, number % 20, name) for name in names] == [{"number": number}] * len(names)
    assert all(
        path.suffix == ".json" and path.name[0] != "." for path in (cache_folder / "planning").iterdir()
    )


def test_a_disk_that_refuses_hinders_nothing(root: Path) -> None:
    (root / ".flowsculpt/planning").write_text("")
    book = PlanningCache(root)
    book.put({"a": 1}, "of this")
    assert book.get(dict, "of this") is None


def test_entries_that_nobody_asks_for_go(root: Path) -> None:
    book = PlanningCache(root)
    book.put({}, "old")
    (entry,) = (root / ".flowsculpt/planning").iterdir()
    os.utime(entry, (0.0, 0.0))
    book.put({}, "new")
    book.prune()
    assert not entry.exists()
    assert book.get(dict, "new") == {}


def test_entries_of_no_root_that_nobody_asks_for_go_when_a_process_writes_one(
    tmp_path: Path, cache_folder: Path
) -> None:
    old = cache_folder / "planning/old.json"
    old.parent.mkdir()
    old.write_text("")
    os.utime(old, (0.0, 0.0))
    shot_source._pruned_user_folder.cache_clear()
    PlanningCache(tmp_path).put({}, "new")
    assert not old.exists()
    assert PlanningCache(tmp_path).get(dict, "new") == {}


def test_a_shot_is_read_once_for_its_copies_and_its_subjects(tmp_path: Path, monkeypatch) -> None:
    read: list[str] = []
    reader = flowsculpt.pipeline.shot.read_shot
    monkeypatch.setattr(
        flowsculpt.pipeline.shot, "read_shot", lambda *given: read.append(given[1]) or reader(*given)
    )
    text = "title: A\nframes: 1-3\nsubjects: {a: {solid: box}, b: {solid: box}}\nresample: off\n"
    source = ShotSource(text, tmp_path / "A010.yaml").with_inputs()
    parts = [source.of_subject(name) for name in source.manifest.subjects]
    assert [part.shot.frames for part in parts] == 2 * [source.shot.frames] and read == [text]
    late = replace(source, text=text.replace("1-3", "1-4"), inputs=None)
    assert late.shot.frames.last == 4 and late.manifest.frames == (1, 2, 3, 4) and len(read) == 2


def test_work_that_was_planned_for_another_file_is_told_as_before(shot: Path) -> None:
    planned = take_of(shot)
    (shot.parent / "wedge.obj").write_text(WEDGE.replace("v 2 0 0", "v 3 0 0"))
    take_of(shot)
    late = replace(from_plain(ShotSource, to_plain(planned.source)), cache=PlanningCache(shot.parent))
    assert late.inputs == input_digests([(shot.parent / "wedge.obj", planned.source.inputs[0][1])])
    assert late.inputs[0][1] != InputFile(shot.parent / "wedge.obj").digest()
    with pytest.raises(Exception, match="changed since the work was planned"):
        assert late.manifest
