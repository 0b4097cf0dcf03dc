"""Files that other programs leave in a show."""

from __future__ import annotations

from tests.conftest import ProjectFolder
from tests.needed_plugins import installed


def test_files_of_other_programs_among_shots_are_left_out(project: ProjectFolder) -> None:
    shots = project.path / "shots"
    for name in ("._T010_tiny.yaml", "._film.yaml", "._T010_tiny.yml", "#T010_tiny.yaml#", "T010_tiny.yaml~"):
        (shots / name).write_bytes(b"\0\5\26\7\0\2\0\0Mac OS X        ")
    (shots / ".#T010_tiny.yaml").symlink_to("user@host.1234:5678")
    (shots / "B.yaml").write_text("extends: nothing\ntitle: B\n")
    done = project.call("status", "--json")
    assert done.code == 3 and done.err.count("\n") == 1
    assert "._" not in done.out + done.err and ".#" not in done.out + done.err


def test_a_shot_with_another_suffix_is_said_to_be_passed_over(project: ProjectFolder) -> None:
    (project.path / "shots/B.yml").write_text(project.shot.read_text())
    for words in installed(["status"], ["validate"]):
        done = project.call(*words)
        assert done.code == 0 and "shots/B.yml is passed over" in done.err
    for words in installed(["validate", "B"]):
        assert "Rename it to B.yaml" in project.call(*words).err
