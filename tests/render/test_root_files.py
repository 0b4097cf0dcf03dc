"""Changes below a root follow no link, whenever one takes the place of a folder."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from flowsculpt.pipeline.production.store.event_log import EventLog
from flowsculpt.pipeline.production.store.locks import Locks
from flowsculpt.pipeline.production.store.paths import SUFFIXES
from flowsculpt.pipeline.production.store.store import Store
from flowsculpt.render.base import root_files
from flowsculpt.render.base.atomic_write import atomic_write, make_folder
from flowsculpt.render.base.python_process import PACKAGE_ROOT, environment
from flowsculpt.render.base.render_errors import MachineError
from tests.needed_plugins import is_of_installed

Folders = tuple[Path, Path]
"""A root, and a folder elsewhere with a file of the user's."""


@pytest.fixture
def folders(tmp_path: Path) -> Folders:
    root, elsewhere = tmp_path / "show", tmp_path / "home"
    for folder in (root, elsewhere / "2010"):
        folder.mkdir(parents=True)
    for file in (elsewhere / "a.txt", elsewhere / "2010/a.jpg"):
        file.write_text("mine")
        os.utime(file, (1, 1))
    root_files.guard(root)
    return root, elsewhere


def contents(folder: Path) -> list[tuple[str, int, bytes]]:
    """Return names, times and bytes of all files of a folder."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    names = [path.relative_to(folder).as_posix() for path in (*files, *folder.rglob("*"))]
    return [*((name, 0, b"") for name in names), *(("", f.stat().st_mtime_ns, f.read_bytes()) for f in files)]


CHANGES: dict[str, Callable[[Path], object]] = {
    "remove": lambda folder: root_files.remove_file(folder / "a.txt"),
    "remove_tree": lambda folder: root_files.remove_tree(folder / "2010"),
    "remove_and_prune": lambda folder: root_files.remove_file(folder / "2010" / "a.txt", prune=True),
    "set_time": lambda folder: root_files.set_time(folder / "a.txt", 5.0),
    "touch": lambda folder: root_files.touch(folder / "b.txt"),
    "make_folder": lambda folder: make_folder(folder / "2011"),
    "append": lambda folder: root_files.appended(folder / "a.txt").close(),
    "truncate": lambda folder: root_files.open_file(folder / "a.txt", os.O_WRONLY | os.O_TRUNC),
    "log": lambda folder: EventLog(folder / "a.txt").write("run"),
    "write": lambda folder: written(folder / "a.txt"),
}


def written(path: Path) -> None:
    with atomic_write(path) as draft:
        draft.write_text("ours")


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES.keys())
@pytest.mark.parametrize("place", [".flowsculpt", "renders/A/draft/frames", "bred/A_1", ".flowsculpt/store"])
def test_no_change_is_made_behind_a_link(
    folders: Folders, place: str, change: Callable[[Path], object]
) -> None:
    root, elsewhere = folders
    (root / place).parent.mkdir(parents=True, exist_ok=True)
    (root / place).symlink_to(elsewhere)
    before = contents(elsewhere)
    for folder in (root / place, root / place / "2010"):
        with pytest.raises(MachineError, match="is a link to"):
            change(folder)
    assert contents(elsewhere) == before


def test_a_folder_that_a_link_replaces_meanwhile_gets_the_file_all_the_same(folders: Folders) -> None:
    root, elsewhere = folders
    path, before = root / ".flowsculpt/plans/a.txt", contents(elsewhere)
    with atomic_write(path) as draft:
        path.parent.rename(root / "aside")
        path.parent.symlink_to(elsewhere)
        draft.write_text("ours")
    assert contents(elsewhere) == before
    assert not root_files._CAN_HOLD or (root / "aside/a.txt").read_text() == "ours"


def test_a_link_in_place_of_a_file_is_replaced_or_removed_itself(folders: Folders) -> None:
    root, elsewhere = folders
    before, path = contents(elsewhere), root / "renders/A/a.txt"
    path.parent.mkdir(parents=True)
    for change in (written, root_files.remove_file, root_files.remove_tree):
        path.unlink(missing_ok=True)
        path.symlink_to(elsewhere / "a.txt")
        change(path)
        assert not path.is_symlink()
    (path.parent / "folder").symlink_to(elsewhere)
    root_files.remove_tree(path.parent / "folder")
    assert not [*path.parent.iterdir()] and contents(elsewhere) == before
    path.symlink_to(elsewhere / "a.txt")
    for change in (lambda path: root_files.appended(path), lambda path: root_files.set_time(path, 9.0)):
        try:
            change(path)
        except MachineError as error:
            assert str(elsewhere) in str(error)
        assert contents(elsewhere) == before


def test_links_that_users_make_are_followed(folders: Folders, tmp_path: Path) -> None:
    root, elsewhere = folders
    (tmp_path / "link").symlink_to(root)
    root_files.guard(tmp_path / "link")
    (root / "deliverables").symlink_to(elsewhere)
    for path in (root / "deliverables/new.txt", tmp_path / "link/renders/A/new.txt"):
        written(path)
        assert path.resolve().read_text() == "ours"


@pytest.mark.parametrize("kind", SUFFIXES)
def test_a_link_within_the_store_is_not_followed(folders: Folders, kind: str) -> None:
    root, elsewhere = folders
    store, key = Store(root, url=None), "0123456789abcdef"
    path = store.path(kind, key)
    before = contents(elsewhere)
    path.parent.mkdir(parents=True)
    path.symlink_to(elsewhere / "a.txt")
    assert not store.holds(kind, key), "it is not of ours"
    store.put(kind, key, lambda draft: draft.write_text("ours"))
    assert not path.is_symlink() and path.read_text() == "ours" and contents(elsewhere) == before


def test_the_store_of_another_show_is_not_ours(folders: Folders) -> None:
    root, elsewhere = folders
    other = elsewhere / "show"
    for show in (root, other):
        root_files.guard(show)
        with Locks(show).hold_with_writers():
            pass
    (root / ".flowsculpt/store").rename(elsewhere / "moved")
    (root / ".flowsculpt/store").symlink_to(elsewhere / "moved")
    with Locks(root).hold_with_writers():
        written(root / ".flowsculpt/store/mesh/00/a.npz")
    (root / ".flowsculpt/store").unlink()
    (root / ".flowsculpt/store").symlink_to(other / ".flowsculpt/store")
    with (
        pytest.raises(MachineError, match=r"if it is this show's store, run: cp "),
        Locks(root).hold_with_writers(),
    ):
        pass


OTHERS = """
import os, pathlib, shutil, sqlite3, sys
from flowsculpt.render.base import root_files
root = pathlib.Path(sys.argv[1])
os.chdir(root)
root_files.guard(root)
root_files.forbid_links()
there = ".snakemake/log"
changes = [
    lambda: open(f"{there}/a.txt", "a"),
    lambda: open(".snakemake/file", "w"),
    lambda: os.makedirs(f"{there}/b/c"),
    lambda: os.remove(f"{there}/a.txt"),
    lambda: os.rename("shots", f"{there}/2012"),
    lambda: os.rmdir(f"{there}/2013"),
    lambda: os.symlink("a", f"{there}/c"),
    lambda: os.utime(f"{there}/a.txt"),
    lambda: shutil.rmtree(f"{there}/2010"),
    lambda: sqlite3.connect(f"{there}/a.db"),
]
for number, change in enumerate(changes):
    try:
        change()
    except root_files.MachineError:
        continue
    sys.exit(f"change {number} was made")
open(f"{there}/a.txt").read()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="links need a privilege there")
def test_libraries_that_change_files_themselves_are_stopped_at_links(folders: Folders) -> None:
    root, elsewhere = folders
    (root / ".snakemake").mkdir()
    (root / "shots").mkdir()
    (elsewhere / "2013").mkdir()
    (root / ".snakemake/log").symlink_to(elsewhere)
    (root / ".snakemake/file").symlink_to(elsewhere / "a.txt")
    before = contents(elsewhere)
    command = [sys.executable, "-c", OTHERS, str(root)]
    done = subprocess.run(command, env=environment(), cwd=PACKAGE_ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert contents(elsewhere) == before


METHODS = {"unlink", "rmdir", "mkdir", "rename", "touch", "symlink_to", "hardlink_to", "chmod", "rmtree"}
METHODS |= {"write_text", "write_bytes", "utime", "makedirs", "mkdtemp", "removedirs", "truncate"}
"""Functions and methods that change files."""

READING = {"which", "disk_usage", "copyfileobj"}
"""Functions of shutil that change none."""

OF_OS = {"link", "symlink", "remove", "replace", "renames"}
"""Functions of os that do, with names that other things have as well."""

DRAFTS = {"draft", "temporary", "written"}
"""Names of what `atomic_write` yields, and of parameters that are given it."""

OWN_FOLDERS = {
    "render/base/root_files.py": "the one place",
    "render/base/atomic_write.py": "renames drafts in folders that it holds",
    "render/base/user_cache.py": "the user's cache",
    "render/base/kernel_cache.py": "the user's cache",
    "render/mitsuba/llvm.py": "the user's cache",
    "render/mitsuba/engine.py": "Dr.Jit's cache in the user's",
    "render/graphics/three_js.py": "the installed package",
    "render/movie/projection_tags.py": "a sample in a temporary folder",
    "pipeline/production/execution/snakefile.py": "a draft",
    "pipeline/production/store/readers.py": "a draft",
    "pipeline/production/tasks/surfaces.py": "a draft of the store",
    "pipeline/production/store/store.py": "drafts that `atomic_write` yields",
    "pipeline/plugins/authoring/new_files.py": "drafts of files beside the shots",
    "pipeline/plugins/authoring/schema_command.py": "a file beside the shots that the user asks for",
    "pipeline/plugins/authoring/shot_templates.py": "files beside a new shot",
    "pipeline/plugins/become/stored_fits.py": "the user's cache",
    "pipeline/plugins/delivery/gif.py": "memory",
    "pipeline/plugins/breed/generation.py": "the draft of a generation, in a folder that is held",
    "pipeline/plugins/farm/farm_commands.py": "files that the user names",
    "pipeline/plugins/farm/task_runner.py": "the root",
    "pipeline/plugins/interchange/gltf_content.py": "a draft",
    "pipeline/plugins/interchange/model_export.py": "a draft",
    "pipeline/plugins/interchange/vertex_textures.py": "a draft",
    "pipeline/plugins/interchange/web_player.py": "a draft",
    "pipeline/plugins/lettering/letters_command.py": "files that the user names",
    "pipeline/plugins/preview/shot_editor.py": "a draft of the shot file",
    "pipeline/plugins/preview/surface_stream.py": "a temporary folder",
    "pipeline/plugins/remote/remote_files.py": "a draft of the store",
    "pipeline/plugins/versions/publishing.py": "the draft of a version, in a folder that is held",
}
"""Modules that change files elsewhere, or in folders that are held, by what these are."""


def changes_of(source: str) -> Iterator[tuple[int, str]]:
    """Yield line and name of the calls that change files, except those of drafts."""
    for node in ast.walk(ast.parse(source)):
        if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute | ast.Name)):
            continue
        called = node.func.attr if isinstance(node.func, ast.Attribute) else node.func.id
        owner = node.func.value if isinstance(node.func, ast.Attribute) else None
        name = owner.id if isinstance(owner, ast.Name) else ""
        if name in DRAFTS:
            continue
        modes = [value.value for value in (*node.args, *(k.value for k in node.keywords if k.arg == "mode"))
                 if isinstance(value, ast.Constant) and isinstance(value.value, str)]  # fmt: skip
        is_writing = called == "open" and any(mode[:1] in ("w", "a", "x") and len(mode) < 4 for mode in modes)
        is_of_module = (name == "shutil" and called not in READING) or (name == "os" and called in OF_OS)
        if is_writing or is_of_module or (owner is not None and called in METHODS):
            yield node.lineno, called


def test_only_one_module_changes_files_below_a_root() -> None:
    found = {}
    for package in ("pipeline", "render"):
        for path in sorted(Path(PACKAGE_ROOT, package).rglob("*.py")):
            name = path.relative_to(PACKAGE_ROOT).as_posix()
            if calls := [*changes_of(path.read_text(encoding="utf-8"))]:
                found[name] = calls
    unknown = [
        f"{name}:{line}: {called}" for name in found.keys() - OWN_FOLDERS for line, called in found[name]
    ]
    assert not unknown, "by render/base/root_files.py, or with a reason"
    assert {*filter(is_of_installed, OWN_FOLDERS)} <= found.keys(), "reasons that are not needed any more"
