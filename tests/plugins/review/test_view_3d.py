"""The 3-D view of several subjects: surfaces and clouds of a frame are drawn together."""

from __future__ import annotations

import base64
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.mesh import icosphere
from pipeline.plugins.review import view_3d
from render.graphics.three_js import three_js
from tests.plugins.review.looker import Opened
from tests.plugins.review.studio import Desk

Arrays = dict[str, NDArray[np.generic]]


def ball(middle: tuple[float, float, float], radius: float) -> Arrays:
    """A sphere of triangles, as normals files hold one."""
    mesh = icosphere(10)
    normals = mesh.vertices / np.linalg.norm(mesh.vertices, axis=1, keepdims=True)
    return {"vertices": normals * radius + middle, "normals": normals, "faces": mesh.faces}


def cloud(middles: list[tuple[float, float, float]], radii: list[float]) -> Arrays:
    return {"vertices": np.array(middles), "radii": np.array(radii, np.float32)}


def test_surfaces_and_clouds_of_a_frame_come_together() -> None:
    subjects = [ball((0, 0, 0), 1.0), cloud([(3, 0, 0), (4, 0, 0)], [0.5, 0.25]), ball((0, 5, 0), 1.0)]
    text = view_3d.as_script("m.js", view_3d.joined(subjects))
    data = json.loads(text.removeprefix('reviewModel("m.js", ').removesuffix(");\n"))
    assert (data["triangles"], data["points"]) == (2 * len(icosphere(10).faces), 2)
    low, high = np.array(data["low"]), np.array(data["high"])
    assert np.allclose((low, high), [(-1, -1, -1), (4.25, 6, 1)], atol=0.01)
    centres = np.frombuffer(base64.b64decode(data["centres"]), "<u2").reshape(-1, 3) / 65535.0
    assert np.allclose(low + centres * (high - low), [(3, 0, 0), (4, 0, 0)], atol=1e-4)
    assert np.frombuffer(base64.b64decode(data["radii"]), "<f4").tolist() == [0.5, 0.25]


@pytest.fixture
def page_of(desk: Desk, tmp_path: Path) -> Callable[..., Path]:
    """A page whose meshes are replaced by others."""

    def written(*subjects: Arrays) -> Path:
        folder = Path(shutil.copytree(desk.page().parent, tmp_path / f"page{len(list(tmp_path.iterdir()))}"))
        for script in (folder / "models").iterdir():
            script.write_text(view_3d.as_script(script.name, view_3d.joined(subjects)))
        return folder / "index.html"

    return written


@pytest.mark.skipif(three_js() is None, reason="three.js is not set up here")
def test_a_point_is_drawn_beside_a_surface_and_as_large_as_one(
    opened: Opened, page_of: Callable[..., Path]
) -> None:
    box = cloud([(-3, -1.5, 0), (3, 1.5, 0)], [1e-3, 1e-3])
    lit = []
    for subject in (ball((1.5, 0, 0), 1.0), cloud([(1.5, 0, 0)], [1.0])):
        look = opened(page_of(ball((-1.5, 0, 0), 0.8), subject, box), frame=1)
        look.press("m")
        look.wait("review.panels.mesh.shownName")
        lit.append(look.seen(".mesh-stage").max(axis=2) > 40)
        assert "triangles and " in look.tab.inner_text("#panel-mesh .note")
    middle = lit[0].shape[1] // 2
    assert (lit[0][:, :middle] == lit[1][:, :middle]).mean() > 0.999
    surface, points = (each[:, middle:].sum() for each in lit)
    assert 0.03 * lit[0].size < surface and 0.93 < points / surface < 1.07
