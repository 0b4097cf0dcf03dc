"""Hooks of a profile: told when a run is done or has failed, and by name where they are wrong."""

from __future__ import annotations

import json
import shlex
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from flowsculpt.pipeline.errors import FlowsculptError
from flowsculpt.pipeline.plugins.versions.hooks import HOOKS_FILE, hooks_of, tell_of_delivery, tell_of_run
from flowsculpt.pipeline.production.store.event_log import EventLog
from flowsculpt.pipeline.production.store.paths import EVENTS


def teller(path: Path, code: int = 0) -> str:
    program = f"import sys; open({str(path)!r}, 'a').write(sys.stdin.read() + '\\n'); sys.exit({code})"
    return shlex.join([sys.executable, "-c", program])


def common(root: Path) -> SimpleNamespace:
    return SimpleNamespace(root=root, profile=SimpleNamespace(folder=root))


def logged(root: Path, run: str, *faults: str) -> None:
    path = root / EVENTS / f"{run}.jsonl"
    path.parent.mkdir(parents=True, exist_ok=True)
    log, about = EventLog(path, "render_0000"), {"stage": "render", "shot": "A010", "quality": "draft"}
    log.write("frame", **about, frame=1, found=False)
    log.write("frame", **about, frame=2, found=True)
    for message in faults:
        log.write("fail", **about, frame=3, message=message)


def test_a_run_that_is_done_and_one_that_failed_have_hooks_of_their_own(tmp_path: Path) -> None:
    done, failed = tmp_path / "done.json", tmp_path / "failed.json"
    hooks = {"run_done": teller(done), "run_failed": [teller(failed), teller(failed)]}
    (tmp_path / HOOKS_FILE).write_text(json.dumps(hooks))  # JSON is YAML
    logged(tmp_path, "one")
    logged(tmp_path, "two", "frame 3: the disk is full")
    for run in ("one", "two"):
        assert tell_of_run(common(tmp_path), run) == ""
    told = json.loads(done.read_text())
    assert (told["event"], told["run"], told["frames"], told["failures"]) == ("run_done", "one", 1, [])
    assert told["shots"] == [{"shot": "A010", "quality": "draft"}] and told["root"] == str(tmp_path)
    first, second = map(json.loads, failed.read_text().splitlines())
    assert first == second and first["event"] == "run_failed"
    assert first["failures"][0] | {"quality": "draft"} == {
        "shot": "A010",
        "quality": "draft",
        "stage": "render",
        "frame": 3,
        "message": "frame 3: the disk is full",
    }


def test_a_delivery_has_a_hook_with_its_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    hooks = {"files_delivered": [teller(tmp_path / "told"), teller(tmp_path / "again", 3)]}
    (tmp_path / HOOKS_FILE).write_text(json.dumps(hooks))
    file = {"path": "deliver/a.mp4", "as": "review", "frames": 6, "up_to_date": False}
    tell_of_delivery(common(tmp_path), {"deliverables": [file], "failed": ["a frames 3"]})
    told = json.loads((tmp_path / "told").read_text())
    assert told["event"] == "files_delivered" and told["failed"] == ["a frames 3"]
    assert told["deliverables"] == [{**file, "path": str(Path("deliver/a.mp4").absolute())}]
    assert "ended with 3. The files are there nevertheless" in " ".join(capsys.readouterr().err.split())


def test_a_hook_that_fails_is_a_warning(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / HOOKS_FILE).write_text(json.dumps({"run_done": teller(tmp_path / "told", 7)}))
    logged(tmp_path, "one")
    assert tell_of_run(common(tmp_path), "one") == ""
    said = " ".join(capsys.readouterr().err.split())
    assert "it ended with 7. The run is not affected" in said


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("run_don: ls", "run_don is not an event. Did you mean 'run_done'?"),
        ("run_done: 3", "run_done is 3; it must be a command"),
        ("run_done: no-such-program", "program no-such-program not found"),
        ("[ls]", "not hooks; write names and commands"),
        ("run_done: [", "cannot be read"),
    ],
)
def test_a_wrong_file_of_hooks_is_named(tmp_path: Path, text: str, fault: str) -> None:
    (tmp_path / HOOKS_FILE).write_text(text)
    with pytest.raises(FlowsculptError) as error:
        list(hooks_of(tmp_path, "run_done"))
    assert fault in str(error.value) and str(tmp_path / HOOKS_FILE) in str(error.value)


def test_a_profile_without_hooks_has_none(tmp_path: Path) -> None:
    assert list(hooks_of(tmp_path, "run_done")) == []
