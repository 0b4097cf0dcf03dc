"""Exports that are current are kept; what was replaced, damaged or cut short is never taken for current."""

from __future__ import annotations

import json
import os
import platform
import threading
from pathlib import Path

import pytest

from flowsculpt.pipeline.plugins.interchange.exported_frame import KeyedFiles
from flowsculpt.pipeline.production.store.store import Store
from tests.conftest import commanded
from tests.needed_plugins import needs_plugins
from tests.simulated_show import simulated

NAME = "T010_tiny"
SHOT = """\
title: A box, twisted
frames: 1-2
subject: {solid: box, size: [2, 2, 2]}
resample: {max_edge_length: 0.9}
flows: [twist: {axis: y, amount: {ease: linear, keys: {1: 0, 2: 20}}}]
"""
EDIT = "flows.0.twist.amount.keys.2=50"
STILL = ("-f", "2")
FORMS = {
    "ply": ("ply", *STILL),
    "obj": ("obj", *STILL),
    "glb": ("glb", *STILL),
    "stl": ("stl", *STILL),
    "gltf": ("gltf",),
    "abc": ("abc",),
    "vat": ("vat",),
    "usd": ("usd",),
    "one mesh": ("usd", "--one-mesh"),
}
DEAD = 2**22 + 1
"""The number of a process that no Linux has."""


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("exports")
    simulated(root, SHOT)
    return root


def export(root: Path, form: str, *words: str) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(root)
        code, said = commanded(root, "export", *FORMS[form][:1], NAME, *FORMS[form][1:], *words)
    assert code == 0, said


@pytest.mark.parametrize("form", FORMS)
def test_an_export_killed_before_it_notes_its_key_is_not_current(
    root: Path, tmp_path: Path, form: str
) -> None:
    output = ("-o", str(tmp_path))
    export(root, form, *output)
    right = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    (keys,) = (name for name in right if name.endswith("keys.json"))
    export(root, form, *output, "--set", EDIT)
    others = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert others.keys() == right.keys() and others != right
    (tmp_path / keys).write_bytes(right[keys])
    export(root, form, *output)
    now = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert now == right or (form == "abc" and now != others)  # Alembic files say when they were written


def test_a_byte_changed_in_an_exported_file_has_it_written_again(root: Path, tmp_path: Path) -> None:
    export(root, "vat", "-o", str(tmp_path))
    file = tmp_path / f"{NAME}.positions.exr"
    whole, facts = file.read_bytes(), file.stat()
    file.write_bytes(whole[:40] + bytes([whole[40] ^ 1]) + whole[41:])
    os.utime(file, ns=(facts.st_atime_ns, facts.st_mtime_ns))
    export(root, "vat", "-o", str(tmp_path))
    assert file.read_bytes() == whole


def test_textures_of_a_shot_that_loops_are_current_until_it_changes(root: Path, tmp_path: Path) -> None:
    words = ("-o", str(tmp_path), "--set", "loop=true")
    for _ in range(2):
        before = {path.name: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
        export(root, "vat", *words)
    assert {path.name: path.stat().st_mtime_ns for path in tmp_path.iterdir()} == before


def test_the_second_of_two_exports_at_once_waits_and_keeps_the_files_of_the_first(tmp_path: Path) -> None:
    first, second = (KeyedFiles(tmp_path / "out", "a.keys.json", Store(tmp_path)) for _ in range(2))
    second.is_current("a.bin", "key")  # found none yet
    seen = list[bool]()

    def export_again() -> None:
        with second.changing():
            seen.append(second.is_current("a.bin", "key"))

    other = threading.Thread(target=export_again)
    with first.changing():
        other.start()
        first.write("a.bin", "key", lambda draft: draft.write_bytes(b"whole"))
        other.join(0.3)
        assert not seen
    other.join()
    assert seen == [True]


@needs_plugins("maintenance")
def test_drafts_of_killed_exports_are_removed_by_the_next_one_and_by_clean(root: Path) -> None:
    export(root, "ply")
    folder = root / "renders" / NAME / "models"
    drafts = [folder / f".{platform.node()}+{process}+{'0' * 32}.ply" for process in (DEAD, os.getppid())]
    for command in (("export", "ply", NAME, *STILL), ("clean",)):
        for draft in drafts:
            draft.touch()
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(root)
            code, said = commanded(root, *command)
        assert code == 0, said
        assert [draft.exists() for draft in drafts] == [False, True], "a process at work keeps its own"


@pytest.mark.parametrize(
    "noted", ["[]", '{"x": [1]}', "[" * 100_000, '{"T010_tiny.0002.ply": {"digest": 1}}', "{"]
)
def test_an_export_with_damaged_keys_is_written_again(root: Path, tmp_path: Path, noted: str) -> None:
    keys = tmp_path / f"{NAME}.ply.keys.json"
    keys.write_text(noted)
    export(root, "ply", "-o", str(tmp_path))
    assert json.loads(keys.read_text())[f"{NAME}.0002.ply"]["key"]
