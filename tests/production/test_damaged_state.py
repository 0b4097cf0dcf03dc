"""State between runs that is damaged, cut short, or of something else counts as none."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from flowsculpt.pipeline.production.planning.profile import avoid
from flowsculpt.pipeline.production.store.paths import STATE
from flowsculpt.pipeline.production.store.store import UPLOADS
from tests.conftest import HOSTILE, QUALITY, ProjectFolder
from tests.needed_plugins import installed

NAME = "T010_tiny"
COMMANDS = installed(
    ("status",),
    ("--json", "status"),
    ("why", NAME, "3", "-q", QUALITY),
    ("report",),
    ("render", NAME, "-q", QUALITY),
    ("validate",),
    ("verify",),
    ("clean",),
)
WHOLE = {
    "empty": b"",
    "a list": b"[]",
    "null": b"null",
    "a text": b'"x"',
    "a number of 400 digits": b"7" * 400,
    "deep brackets": b"[" * 100_000,
    "of a later version": b'{"version": 999, "format": 999, "later": {}}',
    "binary": b"\xff\xfe\x00\x80" * 20,
}
OTHERS = ([], None, "x", 10**399, {}, -1, 1.5)


def damages(content: bytes) -> Iterator[tuple[str, bytes]]:
    """Yield what may have become of a file, and how it is called."""
    yield from WHOLE.items()
    yield "cut short", content[: len(content) // 2]
    try:
        data = json.loads(content.splitlines()[0] if b"\n" in content.strip() else content)
    except ValueError:
        return
    for place in _places(data, 3):
        for other in OTHERS:
            yield f"{place} is {str(other)[:9]}", json.dumps(_with(data, place, other)).encode() + b"\n"


def _places(data: object, depth: int) -> Iterator[tuple[object, ...]]:
    """Yield the ways to the values in JSON data, of its lists those to the first items."""
    items = data.items() if isinstance(data, dict) else enumerate(data[:1]) if isinstance(data, list) else ()
    for name, value in items:
        yield (name,)
        yield from ((name, *inner) for inner in (_places(value, depth - 1) if depth > 1 else ()))


def _with(data: object, place: tuple[object, ...], other: object) -> object:
    """Return a copy of JSON data with another value at a place."""
    copy = json.loads(json.dumps(data))
    inner = copy
    for name in place[:-1]:
        inner = inner[name]
    inner[place[-1]] = other
    return copy


def state_of(project: ProjectFolder) -> list[Path]:
    """Return the files that hold state: all below STATE but the store."""
    return [
        path
        for path in sorted((project.path / STATE).rglob("*"))
        if path.is_file() and path.relative_to(project.path / STATE).parts[0] not in ("store", "checkpoints")
    ]


@pytest.fixture(scope="module")
def whole_project(finished_project: ProjectFolder, tmp_path_factory: pytest.TempPathFactory) -> ProjectFolder:
    """A finished project in which all commands have left their state."""
    made = finished_project.copy(tmp_path_factory.mktemp("whole") / HOSTILE)
    avoid(made.path, NAME, "cuda_ad_rgb", "a reason")
    (made.path / UPLOADS).mkdir()
    (made.path / UPLOADS / ".DS_Store").touch()
    for command in COMMANDS[:-1]:
        assert made.call(*command).code == 0
    return made


@pytest.fixture
def whole(whole_project: ProjectFolder, tmp_path: Path) -> ProjectFolder:
    return whole_project.copy(tmp_path / HOSTILE)


def shown(project: ProjectFolder) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in (project.path / "renders").rglob("*") if path.is_file()}


def require_all_commands(project: ProjectFolder, damaged: dict[Path, bytes], how: str) -> None:
    """Run all commands, each with files that are damaged before."""
    for command in COMMANDS:
        for path, content in damaged.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            path.unlink(missing_ok=True)
            path.write_bytes(content)
        said = project.call(*command)
        assert said.code == 0 and "Traceback" not in said.err, f"{how}: {command}: {said.err}{said.out}"


@pytest.mark.parametrize("how", [*WHOLE, "cut short"])
def test_state_that_is_all_damaged_fails_no_command_and_changes_no_picture(
    whole: ProjectFolder, how: str
) -> None:
    before = shown(whole)
    files = {path: dict(damages(path.read_bytes()))[how] for path in state_of(whole)}
    require_all_commands(whole, files, how)
    assert shown(whole) == before


def test_folders_in_the_places_of_state_fail_no_command_that_reads(whole: ProjectFolder) -> None:
    for path in state_of(whole):
        if path.suffix != ".b2" and path.name != "lock":
            path.unlink()
            path.mkdir()
    for command in COMMANDS[:4]:
        said = whole.call(*command)
        assert "Traceback" not in said.err + said.out and said.code in (0, 4), f"{command}: {said.err}"


def test_facts_of_another_kind_in_logs_and_histories_fail_no_command(whole: ProjectFolder) -> None:
    for folder in ("history", "variants", "events"):
        for path in sorted((whole.path / STATE / folder).iterdir()):
            content = path.read_bytes()
            lines = [damaged for how, damaged in damages(content) if how not in WHOLE]
            for number in range(0, len(lines), 9 if folder != "events" else len(lines)):
                path.write_bytes(lines[number] if folder != "events" else b"".join(lines) + content)
                for command in (*COMMANDS[:2], COMMANDS[3]):
                    said = whole.call(*command)
                    assert said.code == 0 and "Traceback" not in said.err, f"{path.name}: {said.err}"
            path.write_bytes(content)


@pytest.mark.soak
def test_each_file_of_state_may_hold_anything(whole: ProjectFolder, tmp_path: Path) -> None:
    backup = shutil.copytree(whole.path, tmp_path / "backup", copy_function=os.link)
    for path in state_of(whole):
        content = (backup / path.relative_to(whole.path)).read_bytes()
        for how, damaged in damages(content):
            require_all_commands(whole, {path: damaged}, f"{path.name}, {how}")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
