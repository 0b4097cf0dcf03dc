"""The walking figure of B200_walker: the file is what the script writes, and its feet carry it."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np

from flowsculpt.pipeline.mesh.read import ModelFile
from tests.needed_plugins import needs_plugins

pytestmark = needs_plugins("interchange", "people")


def poses(path: Path, times: np.ndarray) -> np.ndarray:
    """Return the vertices (T, V, 3) of a file at times."""
    moving = ModelFile(path).motion()
    found = np.stack([moving.at(float(time)).points for time in times])
    moving.close()
    return found


def test_the_file_holds_what_the_script_makes(tmp_path: Path) -> None:
    from examples import walker

    (tmp_path / "again.glb").write_bytes(walker.walker())
    times = walker.SECONDS * np.array([0.0, 0.3, 0.7])
    np.testing.assert_allclose(poses(tmp_path / "again.glb", times), poses(walker.FILE, times), atol=1e-4)


def test_it_walks_on_its_soles_and_they_do_not_slide() -> None:
    from examples import walker

    speed = walker.STRIDE / (walker.DUTY * walker.SECONDS)
    times = walker.SECONDS * np.arange(30) / 30
    points = poses(walker.FILE, times)
    assert np.abs(points[:, :, 1].min(axis=1)).max() < 0.005
    assert points[:, :, 1].max() < 1.02
    step = times[1]
    for before, after in pairwise(points):
        lowest = np.argsort(before[:, 1])[:30]  # of the foot that stands
        slid = (after - before)[lowest, 2] + speed * step
        assert np.abs(np.median(slid)) < 0.004
