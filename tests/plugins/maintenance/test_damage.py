"""Digests: a flipped bit in any file that was written is found, and the film that shows it is healed."""

from __future__ import annotations

import random
import shutil
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from flowsculpt.pipeline.errors import FrameError
from flowsculpt.pipeline.plugins.maintenance.verify import (
    PublishedFile,
    ShownFile,
    StoredFile,
    checked,
    inode,
    published_files,
    shown_files,
    shown_with_digest,
    verify,
    verify_shown,
    verify_stored,
)
from flowsculpt.pipeline.production.store.digests import digest_of
from flowsculpt.pipeline.production.store.store import Store
from flowsculpt.render.post.image import read_header
from tests.conftest import QUALITY
from tests.needed_plugins import installed

NAME = "T010_tiny"
FLIPS = 2000
EVERY = 100
"""Flips of which one is looked for among all files, and the others in the file that they hit."""

EVERYTHING = installed(
    ("film", "-q", "draft"),
    ("render", NAME, "-f", "1-3", "--scale", "50%"),
    ("render", NAME, "-f", "2", "--crop", "0.25,0.25,0.75,0.75"),
    *(("stills", NAME, "-f", "1-2", "--as", form) for form in ("png", "png16", "jpeg")),
    ("turntable", NAME, "--frames", "4", "--turn", "object", "--look", "clay,glaze"),
    ("wedge", NAME, "--vary", "look=clay,glaze", "-f", "2-3"),
    ("sheet", NAME, "-f", "1-4"),
    ("deliver", NAME, "--as", "review,prores4444,ffv1", "--slate", "apart"),
    ("deliver", "film", "--as", "h265"),
    ("preview", NAME),
    ("preview", NAME, "--at", "3"),
    ("figures", NAME),
    ("curves", NAME),
    ("publish", NAME),
    ("review", NAME),
)
"""Commands that write files of every kind; none of plug-ins that are not installed."""


@pytest.fixture
def stocked(project: Any) -> Any:
    """A project with files of every kind."""
    for words in EVERYTHING:
        done = project.run(*words)
        assert done.code == 0, f"{words}: {done.err}"
    return project


@contextmanager
def flipped(path: Path, chance: random.Random) -> Iterator[None]:
    """Flip one bit of a file in place, and flip it back at the end."""
    place, mask = chance.randrange(path.stat().st_size), 1 << chance.randrange(8)
    flip(path, place, mask)
    try:
        yield
    finally:
        flip(path, place, mask)


def flip(path: Path, place: int, mask: int) -> None:
    path.chmod(0o644)
    with path.open("r+b") as file:
        file.seek(place)
        value = file.read(1)[0]
        file.seek(place)
        file.write(bytes([value ^ mask]))


def faults(store: Store, only: Path | None = None) -> set[tuple[int, int]]:
    """Return the inodes of the files that `verify` finds damaged, among all or of one path alone."""
    if only is None:
        stored, paths = list(verify(store, 1)), shown_with_digest(store)
    else:
        stored = [verify_stored(store, *entry) for entry in store.entries() if entry[2] == only]
        paths = [path for path in (only,) if not stored and "published" not in only.parts]
    shown = verify_shown(store, stored, paths, 1)
    versions = checked((file for file in published_files(store) if only in (None, file.path)), 1)
    files: list[StoredFile | ShownFile | PublishedFile] = [*stored, *shown, *versions]
    return {inode(file.path) for file in files if file.fault is not None}


def kind_of(path: Path, root: Path) -> str:
    """Return the kind of a file: that of the store, or its folder in renders/ and its suffix."""
    parts = path.relative_to(root).parts
    if parts[0] != "renders":
        return parts[2]
    return f"{'/'.join(part for part in parts[1:-1] if part != NAME)} {path.suffix}"


def files_by_kind(root: Path) -> dict[str, list[Path]]:
    """Return all files that were written, links to one file once."""
    store, kinds, seen = Store(root), dict[str, list[Path]](), set[tuple[int, int]]()
    versions = sorted(path for path in (root / "renders/published").rglob("*") if path.is_file())
    for path in (*(path for _, _, path in store.entries()), *shown_files(root), *versions):
        if inode(path) not in seen:
            seen.add(inode(path))
            kinds.setdefault(kind_of(path, root), []).append(path)
    return kinds


def flips_found(root: Path, count: int, seed: int) -> Counter[str]:
    """Flip bits, one at a time, in all kinds of files; return how many flips were found, by kind."""
    store, chance, kinds, found = Store(root), random.Random(seed), files_by_kind(root), Counter[str]()
    assert not faults(store)
    for index in range(count):
        kind = sorted(kinds)[index % len(kinds)]
        path = chance.choice(kinds[kind])
        with flipped(path, chance):
            alone = path if index % EVERY else None
            assert faults(store, alone) == {inode(path)}, f"a flip in {path} was not found"
        found[kind] += 1
    assert not faults(store)
    return found


def test_a_flipped_bit_is_found_in_every_kind_of_file(finished: Any) -> None:
    found = flips_found(finished.path, 24, seed=20)
    assert {"mesh", "normals", "cameras", "raw", "frame", "movie"} < {*found}


@pytest.mark.soak
def test_two_thousand_flipped_bits_are_found_in_files_of_every_kind(stocked: Any) -> None:
    found = flips_found(stocked.path, FLIPS, seed=2000)
    print(f"{found.total()} of {FLIPS} found: {dict(found)}")
    assert {"mesh", "raw", "frame", "cameras", "movie", "mov", "png", "png16", "jpeg", "measures"} < {*found}
    assert any(kind.startswith("review") for kind in found) and any("preview" in kind for kind in found)


def test_every_reader_refuses_a_file_with_a_flipped_bit(finished: Any) -> None:
    """Whatever the reader: it is not called."""
    store, chance = Store(finished.path), random.Random(3)
    entries = list(store.entries())
    assert {"mesh", "normals", "cameras", "raw", "frame", "movie"} <= {kind for kind, _, _ in entries}
    for kind, key, path in entries:
        flip(path, chance.randrange(path.stat().st_size), 1 << chance.randrange(8))
        with pytest.raises(FrameError, match="shown is damaged"):
            store.read(kind, key, Path("shown"), lambda _: pytest.fail("a damaged file is read"))
        assert not path.exists()


@pytest.mark.soak
def test_a_film_heals_what_is_damaged_on_the_way_to_it_and_is_the_same_to_the_bit(finished: Any) -> None:
    """Damaged are a finished frame, and all that it is made of."""
    root, store, chance = finished.path, Store(finished.path), random.Random(4)
    movies = sorted((root / "renders").rglob("*.mp4"))
    before = {path: digest_of(path) for path in movies}
    made_of = read_header(finished.frames()[2])
    (cameras,) = (key for kind, key, _ in store.entries() if kind == "cameras")
    names = [("frame", made_of["key"]), ("raw", made_of["raw_key"]), ("cameras", cameras)]
    names += [("normals", made_of["normals_key"]), ("mesh", made_of["mesh_key"])]
    for kind, key in names:
        path = store.path(kind, key)
        flip(path, chance.randrange(path.stat().st_size), 1 << chance.randrange(8))
    shutil.rmtree(root / ".flowsculpt/store/movie")
    done = finished.run("film", "-q", QUALITY)
    assert done.code == 0, done.err
    assert {path: digest_of(path) for path in movies} == before
    assert not any(file.fault for file in verify(store, 1))
