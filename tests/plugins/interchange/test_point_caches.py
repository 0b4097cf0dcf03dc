"""Point caches hold the points of one mesh in each frame, in the order of their OBJ's vertices."""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.mesh.read import read_mesh
from flowsculpt.pipeline.plugins.interchange.unifying import one_mesh
from flowsculpt.pipeline.production.store.store import Store
from tests.conftest import commanded
from tests.plugins.interchange.unified_shots import BOX, TWIST, of_text

SHOT = f"""\
title: A box, twisted
frames: 1-6
rate: 25
subject: {BOX}
resample: {{max_edge_length: 0.5}}
flows: [{TWIST % (6, 250)}]
"""
NAME = "T010_refined"


@pytest.fixture(autouse=True)
def _in_the_show(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def show(root: Path, text: str = SHOT) -> Path:
    """Make a show with one shot; return the folder of its caches."""
    (root / "shots").mkdir()
    (root / "shots" / f"{NAME}.yaml").write_text(text)
    return root / "renders" / NAME / "caches"


def test_pc2_holds_every_frame_to_float32_in_the_order_of_its_obj(tmp_path: Path) -> None:
    caches = show(tmp_path)
    code, words = commanded(tmp_path, "export", "pc2", NAME, "-f", "2-6x2")
    assert code == 0, words
    content = (caches / f"{NAME}.pc2").read_bytes()
    kind, version, points, start, rate, samples = struct.unpack("<12siiffi", content[:32])
    assert (kind, version, start, rate, samples) == (b"POINTCACHE2\0", 1, 2.0, 2.0, 3)
    require_points(tmp_path, np.frombuffer(content, "<f4", offset=32), (2, 4, 6), points)
    mesh = read_mesh(caches / f"{NAME}.pc2.obj")
    first = np.frombuffer(content, "<f4", 3 * points, 32).reshape(-1, 3)
    assert np.array_equal(mesh.vertices.astype(np.float32), first)


def test_mdd_holds_every_frame_to_float32_and_its_seconds(tmp_path: Path) -> None:
    caches = show(tmp_path)
    code, words = commanded(tmp_path, "export", "mdd", NAME)
    assert code == 0, words
    content = (caches / f"{NAME}.mdd").read_bytes()
    samples, points = struct.unpack(">ii", content[:8])
    assert np.allclose(np.frombuffer(content, ">f4", samples, 8), np.arange(6) / 25.0)
    require_points(tmp_path, np.frombuffer(content, ">f4", offset=8 + 4 * samples), range(1, 7), points)


def require_points(root: Path, values: np.ndarray, frames: range | tuple[int, ...], points: int) -> None:
    """Require the points of one mesh in these frames."""
    mesh = one_mesh(replace(of_text(root / "shots", SHOT), requested=tuple(frames)), Store(root))
    found = values.reshape(len(frames), points, 3)
    for number, frame in zip(frames, found, strict=True):
        assert np.array_equal(frame, mesh.frame(number).points.astype(np.float32)), number


def test_a_current_cache_is_kept_and_another_reduction_is_written(tmp_path: Path) -> None:
    caches = show(tmp_path)
    commanded(tmp_path, "export", "pc2", NAME)
    before = (caches / f"{NAME}.pc2").stat().st_mtime_ns
    code, words = commanded(tmp_path, "export", "pc2", NAME)
    assert (code, (caches / f"{NAME}.pc2").stat().st_mtime_ns) == (0, before)
    assert "it is current" in words
    code, words = commanded(tmp_path, "--json", "export", "pc2", NAME, "--until", "0.3")
    facts = json.loads(words)
    assert facts["vertices"] < facts["whole"]
    assert facts["error"] < 0.3
    mesh = read_mesh(caches / f"{NAME}.pc2.obj")
    assert len(mesh.vertices) == facts["vertices"]


def test_each_of_several_subjects_has_its_cache_and_one_can_be_chosen(tmp_path: Path) -> None:
    subjects = f"subjects: {{red: {BOX}, pale: {{solid: icosphere, radius: 1, place: [3, 0, 0]}}}}"
    caches = show(tmp_path, SHOT.replace(f"subject: {BOX}", subjects))
    code, words = commanded(tmp_path, "export", "mdd", NAME, "--subject", "pale")
    assert code == 0, words
    assert sorted(file.name for file in caches.glob("*.mdd")) == [f"{NAME}.pale.mdd"]
    assert commanded(tmp_path, "export", "mdd", NAME)[0] == 0
    assert sorted(file.name for file in caches.glob("*.mdd")) == [f"{NAME}.pale.mdd", f"{NAME}.red.mdd"]
    assert len(list(caches.glob("*.mdd.obj"))) == 2


def test_a_dry_run_says_what_would_be_refined_and_writes_nothing(tmp_path: Path) -> None:
    caches = show(tmp_path)
    code, words = commanded(tmp_path, "--dry-run", "export", "pc2", NAME)
    assert (code, caches.exists()) == (0, False)
    assert f"{NAME}: refining 6 frames" in words


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        (("-f", "1,2,5"), 2, "frames 1-2,5 are not evenly spaced"),
        (("--vertices", "12"), 2, "vertices at rest, so one mesh of it cannot have 12"),
    ],
)
def test_what_a_cache_cannot_hold_is_refused(
    words: tuple[str, ...], code: int, says: str, tmp_path: Path
) -> None:
    show(tmp_path)
    found, message = commanded(tmp_path, "export", "pc2", NAME, *words)
    assert found == code
    assert says in message
    assert "\n" not in message.strip()


def test_a_flow_that_fails_is_named_with_its_shot_and_frame(tmp_path: Path) -> None:
    tight = SHOT.replace("max_edge_length: 0.5", "max_edge_length: 0.5, max_vertices: 300")
    show(tmp_path, tight)
    code, message = commanded(tmp_path, "export", "pc2", NAME)
    assert code == 1
    assert message.startswith(f"{NAME} frame ")
