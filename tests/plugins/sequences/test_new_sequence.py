"""`new --sequence`: shots of moving meshes that preview as they are written."""

from __future__ import annotations

from pathlib import Path

import pytest

from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.shot import read_shot
from tests.conftest import commanded
from tests.needed_plugins import needs_plugins
from tests.plugins.sequences.test_sequence_subjects import write_ball

pytestmark = needs_plugins("authoring")


def begun(root: Path, sequence: str) -> tuple[int, str]:
    return commanded(root, "new", "A010_ball", "--sequence", sequence)


@pytest.mark.parametrize(
    ("first", "line"), [(1, "frames: 1-4"), (1001, "frames: 1001-1004"), (-2, "start: -2")]
)
def test_a_shot_of_numbered_files_shows_all_of_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, first: int, line: str
) -> None:
    for number in range(first, first + 4):
        write_ball(tmp_path / "cache", number)
    monkeypatch.chdir(tmp_path)
    code, said = begun(tmp_path, "cache/*.ply")
    assert code == 0, said
    text = (tmp_path / "shots/A010_ball.yaml").read_text()
    assert line in text and '"../cache/ball_####.ply"' in text
    frames = list(animate(read_shot(tmp_path / "shots/A010_ball.yaml")))
    assert len(frames) == 4
    assert frames[0].mesh.vertices.shape == (92, 3)


def test_two_files_of_one_number_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_ball(tmp_path / "cache", 1)
    (tmp_path / "cache/ball_1.ply").write_bytes((tmp_path / "cache/ball_0001.ply").read_bytes())
    monkeypatch.chdir(tmp_path)
    code, said = begun(tmp_path, "cache/*.ply")
    assert code == 2 and "cache/*.ply matches two files that are both number 1. Remove one." in said


def test_a_folder_with_two_sequences_or_none_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, said = begun(tmp_path, "cache/*.ply")
    assert code and "no numbered file matches cache/*.ply" in said
    write_ball(tmp_path / "cache", 1)
    (tmp_path / "cache/other_0001.ply").write_bytes((tmp_path / "cache/ball_0001.ply").read_bytes())
    code, said = begun(tmp_path, "cache/*.ply")
    assert code == 2 and "cache/*.ply matches ball_#.ply and other_#.ply, which are two sequences" in said
