"""Runs of numbered files: what is made again after edits, a kill or a full disk, and files that change."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.errors import FlowsculptError, FrameError, MachineError
from flowsculpt.pipeline.frames import FrameRange
from flowsculpt.pipeline.mesh import TriangleMesh, icosphere
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.planning.plan import Plan
from flowsculpt.pipeline.production.store import readers
from flowsculpt.pipeline.production.store.event_log import EventLog
from flowsculpt.pipeline.production.store.paths import EVENTS
from flowsculpt.pipeline.production.store.store import Store
from flowsculpt.pipeline.production.tasks import surfaces
from flowsculpt.pipeline.production.tasks.job import Context
from flowsculpt.pipeline.shot import Shot, read_shot
from tests.mesh_files import write_ply


def write_drop(root: Path, number: int, lift: float = 0.0) -> None:
    """Write a ball whose number of faces changes, as a file of a cache."""
    ball = icosphere(1 + number % 2)
    points = ball.vertices + np.array([0.0, 0.05 * number + lift, 0.0])
    named = {"vx": 0.0 * points[:, 0], "vy": 1.2 + 0.0 * points[:, 0], "vz": 0.0 * points[:, 0]}
    write_ply(TriangleMesh(points, ball.faces, named), root / f"cache/drop_{number:04d}.ply")


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return begin(tmp_path, 6)


def begin(root: Path, files: int) -> Path:
    for number in range(1, files + 1):
        write_drop(root, number)
    (root / "shots").mkdir()
    (root / "shots/A.yaml").write_text(
        f"title: Drops\nframes: 1-{files}\nsubject: {{sequence: ../cache/drop_####.ply}}\n"
    )
    return root


def shot_of(root: Path) -> Shot:
    return read_shot(root / "shots/A.yaml")


def contexts(root: Path) -> list[Context]:
    """Return the contexts of the jobs that make missing mesh frames."""
    shot = shot_of(root)
    plan: Plan = Project(root, 1).meshes(["A"], FrameRange.parse(f"1-{max(shot.frames)}"))
    log = root / EVENTS / f"{plan.name}.jsonl"
    return [Context(root, plan, job, EventLog(log, job.name)) for job in plan.jobs]


def planned(root: Path) -> list[int]:
    return sorted(number for context in contexts(root) for number in context.job.frames)


def simulate(root: Path) -> bool:
    done = [surfaces.simulate(context) for context in contexts(root)]
    return all(done)


def require_whole(root: Path) -> None:
    """Check that all frames are stored, with the bits that they have when they are made at once."""
    assert not planned(root)
    for frame in animate(shot_of(root)):
        with np.load(root / f"renders/A/meshes/A.{frame.number:04d}.npz") as stored:
            np.testing.assert_array_equal(stored["vertices"], frame.mesh.vertices)
            np.testing.assert_array_equal(stored["faces"], frame.mesh.faces)


def test_after_an_edit_of_file_40_of_96_frames_39_to_41_are_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    root = begin(tmp_path, 96)
    assert simulate(root) and not planned(root)
    write_drop(root, 40, lift=0.01)
    assert planned(root) == [39, 40, 41]
    assert simulate(root)
    require_whole(root)


_KILLED = """
import os, signal, sys
from pathlib import Path
from flowsculpt.pipeline.production.store import readers
from tests.plugins.sequences import test_sequence_runs as runs

write, written = readers.write_npz, []

def writes(path, named):
    if len(written) == 3:
        path.write_bytes(b"half of it")
        os.kill(os.getpid(), signal.SIGKILL)
    written.append(path)
    write(path, named)

readers.write_npz = writes
runs.simulate(Path(sys.argv[1]))
"""


@pytest.mark.slow
def test_after_a_kill_the_frames_that_are_not_stored_are_made_to_the_same_bits(root: Path) -> None:
    ran = subprocess.run(
        [sys.executable, "-c", _KILLED, str(root)],
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])},
    )
    assert ran.returncode == -signal.SIGKILL
    assert planned(root) == [4, 5, 6]
    assert simulate(root)
    require_whole(root)


def test_once_a_full_disk_has_room_the_frames_that_are_not_stored_are_made(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = readers.write_npz

    def fails(path: Path, named: dict[str, object]) -> None:
        if named["key"] == contexts(root)[0].request.keys.mesh(4):
            path.write_bytes(b"half of it")
            raise MachineError(f"{path}: cannot be written: the disk is full")
        write(path, named)

    with monkeypatch.context() as disk:
        disk.setattr(readers, "write_npz", fails)
        assert not simulate(root)
    assert planned(root) == [4, 5, 6]
    assert not [*Store(root).scratch.glob("*"), *Store(root).inner_scratch.glob("*")]
    assert simulate(root)
    require_whole(root)


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("half written", "drop_0004.ply: cannot be read as PLY"),
        (
            "changing",
            "drop_0004.ply: it was changed since the work was planned; run again once it is written",
        ),
        ("gone", "drop_0004.ply: file not found"),
    ],
)
def test_a_file_that_is_written_or_removed_while_a_run_goes_on_fails_its_frames_with_one_line(
    root: Path, kind: str, message: str
) -> None:
    shot, path = shot_of(root), root / "cache/drop_0004.ply"
    if kind == "half written":
        path.write_bytes(path.read_bytes()[:-40])
        shot = shot_of(root)
    elif kind == "changing":
        write_drop(root, 4, lift=0.01)
    else:
        path.unlink()
    shown = []
    with pytest.raises(FrameError) as error:
        for frame in animate(shot):
            shown.append(frame.number)
    assert shown == [1, 2, 3]
    assert message in str(error.value) and "\n" not in str(error.value)


def test_frames_whose_files_are_there_are_made_while_later_ones_are_absent(root: Path) -> None:
    (root / "cache/drop_0005.ply").unlink()
    path, project = root / "shots/A.yaml", Project(root, 2)
    with pytest.raises(FlowsculptError, match=r"1 file not there: 5, for frame 5\. Choose -f 1-4 of"):
        project.request(path, "draft")
    with pytest.raises(FlowsculptError, match=r"1 file not there: 5"):
        project.request(path, "draft", FrameRange.parse("4-5"))
    early = project.request(path, "draft", FrameRange.parse("2-3"))
    assert list(early.requested) == [2, 3] and list(early.manifest.frames) == [1, 2, 3, 4]
    write_drop(root, 5)
    whole = Project(root, 2).request(path, "draft")
    assert list(whole.manifest.frames) == [1, 2, 3, 4, 5, 6]
    assert [whole.keys.mesh(n) for n in (1, 2, 3)] == [early.keys.mesh(n) for n in (1, 2, 3)]
