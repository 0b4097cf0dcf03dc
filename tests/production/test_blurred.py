"""A shutter and layers go through the whole production, and come out again the same."""

from __future__ import annotations

import json

import numpy as np

from flowsculpt.render.post.image import read_exr, read_header
from tests.conftest import QUALITY

NAME = "T010_tiny"
MORE = "shutter: {angle: 360}\naovs: {velocity: float, motion: half, before: float, after: float}\n"


def test_a_shot_is_blurred_and_tells_its_motion(project) -> None:
    project.shot.write_text(project.shot.read_text().replace("6: 60}", "6: 120}") + MORE)
    project.render("5")
    (raw,) = project.frames(kind="raw")
    layers, header = read_exr(raw)
    assert header["motion_samples"] > 1 and header["shutter"] == [-0.5, 0.5]
    inside = layers["matte"] == 1.0
    assert np.linalg.norm(layers["velocity"][inside], axis=1).max() > 1.0
    # The axis of the twist stands still, so that its speed is about the vertical.
    flat = np.abs(layers["velocity"][inside][:, 1]).max()
    assert flat < 0.05 * np.abs(layers["velocity"][inside]).max()
    around = (layers["after"] - layers["before"])[inside] * 12.0
    beside = np.linalg.norm(around - layers["velocity"][inside], axis=1)
    assert np.median(beside) < 0.15 * np.median(np.linalg.norm(around, axis=1))
    assert np.linalg.norm(layers["motion"][inside], axis=1).max() > 1.0


def test_what_a_picture_took_stands_beside_it_and_not_in_it(finished_project) -> None:
    home = finished_project.path / "renders" / NAME / QUALITY
    told = {path.stem: json.loads(path.read_text()) for path in (home / "statistics").glob("*.json")}
    assert len(told) == 6
    for path in finished_project.frames(kind="raw"):
        statistics, header = told[path.stem], read_header(path)
        assert statistics["key"] == header["key"]
        assert set(statistics["seconds"]) >= {"building", "rendering", "reading and writing"}
        assert statistics["vertices"] > 100 and statistics["peak_memory_mib"] > 50
        assert not {"seconds", "peak_memory_mib"} & set(header)
        assert header["lights"] and header["stage"] and header["settings"]["samples"] == 4
