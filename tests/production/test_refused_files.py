"""Folders and files that the system refuses to read or write: one line, exit code 4, and nothing lost."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from unittest import mock

import pytest

from flowsculpt.pipeline.errors import MachineError
from flowsculpt.pipeline.production.execution.snakemake import refusal
from flowsculpt.pipeline.production.store.digests import Digests
from flowsculpt.pipeline.production.store.paths import DIGESTS
from tests.command_server import AT_START, COMMANDS
from tests.conftest import QUALITY, ProjectFolder, Run, commanded
from tests.full_disk import disk_of
from tests.needed_plugins import installed, needs_plugins

NAME, SIZE = "T010_tiny", ("-q", QUALITY)

WRITERS = installed(
    ["curves", NAME, "-o", "curves.png"],
    ["preview", NAME, "--at", "2"],
    ["sheet", NAME, "-f", "1-2", *SIZE],
    ["review", NAME],
    ["stills", NAME, "-f", "1", *SIZE],
    ["deliver", NAME, "--as", "review", *SIZE],
    ["publish", NAME, *SIZE],
    ["export", "otio", "film", *SIZE],
    ["export", "openjd", NAME, *SIZE],
    ["schema", "-o", "schema.json"],
    ["new", "A020_new", "--from", "lorenz"],
)
"""Commands that write another kind of file each, where all frames are rendered."""


def files_of(project: ProjectFolder) -> dict[Path, tuple[int, int]]:
    """Inode and size of every file but those that tell of runs."""
    about_runs = {"locks", "lock", "plans", "events", "logs", "history", "planning", "digests"}
    paths = [path for path in project.path.rglob("*") if path.is_file() and not about_runs & {*path.parts}]
    return {path: (path.stat().st_ino, path.stat().st_size) for path in paths}


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="only Linux has a folder in which nothing can be made")
def test_a_root_that_cannot_be_made_is_named_with_a_remedy(
    project: ProjectFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(project.path)
    code, said = commanded(project.path, "--root", "/proc/there", "render", NAME, *SIZE)
    assert code == 4 and "cannot be written: the folder /proc/there cannot be made; name another" in said


def test_every_command_that_writes_tells_a_disk_that_takes_no_more_and_leaves_what_was_there(
    finished: ProjectFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(finished.path)
    before = files_of(finished)
    for words in WRITERS:
        with disk_of(10):
            code, said = commanded(finished.path, *words)
        assert code == 4 and "larger than this process may write" in said, (words, code, said)
    assert files_of(finished) == before
    with disk_of(10):
        for words in installed(["clean"], ["status"]):
            assert commanded(finished.path, *words)[0] == 0, "one of them frees the disk"


WITHOUT_RIGHTS = """\
import ctypes

def drop(numbers):
    libc, header, sets = ctypes.CDLL(None), (ctypes.c_uint32 * 2)(0x20080522, 0), (ctypes.c_uint32 * 6)()
    assert libc.capget(header, sets) == 0
    for number in numbers:
        assert libc.prctl(24, number, 0, 0, 0) == 0  # PR_CAPBSET_DROP
    for place in range(3):  # effective, permitted, inheritable
        sets[place] &= ~sum(1 << number for number in numbers)
    assert libc.capset(header, sets) == 0

drop((1, 2, 3))  # CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH, CAP_FOWNER
"""
"""What a fork does first: as `setpriv` below."""


def unprivileged(project: ProjectFolder, *words: str) -> Run:
    """Run a command without root's right to read and write what the modes of files forbid."""
    if os.geteuid() != 0:
        return project.run(*words)
    if COMMANDS.is_on:
        first = project.path.parent / "without_rights.py"
        first.write_text(WITHOUT_RIGHTS)
        with mock.patch.dict(os.environ, {AT_START: str(first)}):
            return project.run(*words)
    if shutil.which("setpriv") is None:
        pytest.skip("no setpriv, and root may write whatever the modes of files say")
    humbly = ["setpriv", "--bounding-set=-dac_override,-dac_read_search,-fowner"]
    command = [*humbly, sys.executable, "-m", "flowsculpt", "--no-progress", *words]
    done = subprocess.run(command, cwd=project.path, capture_output=True, text=True, timeout=300)
    assert "Traceback" not in done.stdout + done.stderr, done.stderr
    return Run(done.returncode, done.stdout, done.stderr)


@contextmanager
def mode(folder: Path, change: str) -> Iterator[None]:
    """Change the modes of a folder and all that is in it, as those of another user's files are."""
    subprocess.run(["chmod", "-R", change, folder], check=True)
    try:
        yield
    finally:
        subprocess.run(["chmod", "-R", "u+rwX", folder], check=True)


def is_one_line(done: Run, *says: str) -> bool:
    return done.code == 4 and done.err.count("\n") == 1 and all(words in done.err for words in says)


@needs_plugins("maintenance")
def test_a_read_only_root_can_be_looked_at_and_whatever_writes_says_so(finished: ProjectFolder) -> None:
    shutil.rmtree(finished.path / ".flowsculpt/store/frame")
    with mode(finished.path, "a-w"):
        status, render = unprivileged(finished, "status"), unprivileged(finished, "render", NAME, *SIZE)
    assert status.code == 0 and NAME in status.out
    assert is_one_line(render, ".flowsculpt/lock: cannot be written: permission denied", "--root"), render.err


@pytest.mark.parametrize(
    ("folder", "change", "words"),
    [
        pytest.param(".flowsculpt/store", "000", ["status"], marks=needs_plugins("maintenance")),
        pytest.param(".flowsculpt/store", "a-w", ["render", NAME, *SIZE], marks=pytest.mark.soak),
        pytest.param(
            ".flowsculpt", "000", ["status"], marks=[pytest.mark.soak, needs_plugins("maintenance")]
        ),
        pytest.param(".flowsculpt/locks", "a-w", ["render", NAME, *SIZE], marks=pytest.mark.soak),
        pytest.param(".flowsculpt/events", "a-w", ["render", NAME, *SIZE], marks=pytest.mark.soak),
        pytest.param(".flowsculpt/plans", "a-w", ["render", NAME, *SIZE], marks=pytest.mark.soak),
        pytest.param(".flowsculpt/logs", "a-w", ["render", NAME, *SIZE], marks=pytest.mark.soak),
        pytest.param(
            "renders",
            "a-w",
            ["preview", NAME, "--at", "2"],
            marks=[pytest.mark.soak, needs_plugins("preview")],
        ),
    ],
)
def test_files_of_another_user_are_named_with_what_can_be_done(
    folder: str, change: str, words: list[str], finished: ProjectFolder
) -> None:
    shutil.rmtree(finished.path / ".flowsculpt/store/movie")
    (finished.path / f"renders/{NAME}/{QUALITY}/{NAME}.mp4").unlink()
    if words == ["status"]:
        finished.render("1", quality="draft")  # it tells of whole qualities
    with mode(finished.path / folder, change):
        done = unprivileged(finished, *words)
    assert is_one_line(done, f"{finished.path / folder}", "permission denied", "--root"), done.err
    assert unprivileged(finished, *words).code == 0, "once it may"


@pytest.mark.parametrize("name", ["renders", pytest.param(".flowsculpt", marks=pytest.mark.soak)])
def test_a_file_where_a_folder_should_be_is_told(name: str, finished: ProjectFolder) -> None:
    shutil.rmtree(finished.path / name)
    (finished.path / name).write_text("")
    done = finished.call("render", NAME, *SIZE)
    assert is_one_line(done, f"{finished.path / name}", "a file stands where a folder should be"), done.err


def test_what_snakemake_cannot_write_is_told_by_the_path_that_its_log_names(tmp_path: Path) -> None:
    (tmp_path / ".flowsculpt").mkdir()
    log = tmp_path / "snakemake.log"
    log.write_text("PermissionError: [Errno 13] Permission denied: '.snakemake/log'\n")
    assert refusal(tmp_path, log) == (
        f"{tmp_path / '.snakemake/log'}: cannot be written: permission denied; "
        "choose another folder (--root) or change its owner"
    )
    log.write_text("")
    assert refusal(tmp_path, log) is None
    with disk_of(10):
        assert "larger than this process may write" in str(refusal(tmp_path, log))


def test_a_record_of_digests_that_a_full_disk_cut_short_loses_that_line_alone(tmp_path: Path) -> None:
    digests, files = Digests(tmp_path), [tmp_path / f"{number}.json" for number in range(3)]
    for file in files:
        file.write_text(file.name)
    digests.add(files[0])
    (record,) = (tmp_path / DIGESTS).rglob("*.b2")
    with disk_of(record.stat().st_size + 20), pytest.raises(MachineError, match="larger than this process"):
        digests.add(files[1])
    digests.add(files[2])
    assert [digests.check(file) for file in files] == [True, False, True]


@needs_plugins("maintenance")
@pytest.mark.parametrize(
    ("place", "whole"),
    [
        (".flowsculpt/store/mesh/*/*.npz", False),
        pytest.param(".flowsculpt/store/frame", True, marks=pytest.mark.soak),
        (".flowsculpt/digests", True),
        pytest.param(".flowsculpt/digests/.flowsculpt/store/mesh/*/*.b2", False, marks=pytest.mark.soak),
        (f"renders/{NAME}/{QUALITY}", True),
        pytest.param(f"renders/{NAME}/{QUALITY}/{NAME}.mp4", False, marks=pytest.mark.soak),
    ],
)
def test_verify_names_what_it_may_not_read_and_takes_none_of_it_for_damaged(
    place: str, whole: bool, finished: ProjectFolder
) -> None:
    before = files_of(finished)
    hidden = next(finished.path.glob(place))
    with mode(hidden, "000"):
        done = unprivileged(finished, "verify")
    assert done.code == 4 and f"{hidden}: cannot be read: permission denied" in done.err, done.out + done.err
    assert "Every file that could be read is what it should be." in done.out
    assert whole or done.err.count("\n") == 1
    assert files_of(finished) == before
    assert finished.call("verify").code == 0


@needs_plugins("maintenance")
def test_status_names_a_log_and_a_summary_that_it_cannot_read_and_lists_all_the_same(
    finished: ProjectFolder,
) -> None:
    (history := finished.path / ".flowsculpt/history").mkdir(exist_ok=True)
    log = finished.path / ".flowsculpt/events/20991231-235959-12.jsonl"
    log.write_bytes(b'\xff\x00{"event": 1}\n[]\n{"event": "frame"}\n{"event": "begin", "process": "x"}\n')
    assert finished.call("status").out == unprivileged(finished, "status").out
    summary = history / f"{NAME}.meshes.json"
    with mode(log, "000"):
        summary.write_text("[1]")
        done = unprivileged(finished, "status")
    assert done.code == 0 and NAME in done.out
    assert f"{log}: cannot be read: permission denied" in done.err
    assert f"{summary}: it is damaged" in done.err and done.err.count("\n") == 2, done.err
