"""What subjects measure, in files for other programs."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.plugins.interchange.exported_frame import ExportedFrame, exported_frame, has_values
from flowsculpt.pipeline.plugins.interchange.model_export import write_glb, write_ply
from flowsculpt.pipeline.plugins.interchange.usd_export import sampled_attributes
from flowsculpt.pipeline.shot import Shot, read_shot
from flowsculpt.render.scene.palettes import colour_map
from tests.needed_plugins import needs_plugins

pytestmark = needs_plugins("streams")

TEXT = """
title: T
frames: 1-4
subject:
  path_surface: {line: [[0.2, 0, 0], [1, 0, 0]]}
  velocity: [{rotation: {axis: y, speed: 90}}]
  values: speed
look: {material: clay, measure: {values: {range: [0.5, 1.5]}}}
"""


@pytest.fixture(scope="module")
def exported() -> tuple[Shot, ExportedFrame]:
    shot = read_shot(Path("a.yaml"), TEXT)
    (frame,) = animate(shot, only=frozenset({4}))
    return shot, exported_frame(shot, frame)


def test_frames_for_other_programs_have_values_and_their_colours(
    exported: tuple[Shot, ExportedFrame],
) -> None:
    shot, frame = exported
    assert has_values(shot) and frame.values is not None and frame.colours is not None
    assert frame.values == pytest.approx(np.radians(90) * np.linalg.norm(frame.points, axis=1), rel=0.01)
    least, most = np.argmin(frame.values), np.argmax(frame.values)
    assert np.allclose(frame.colours[[least, most]], colour_map("viridis")[[0, -1]], atol=1e-6)
    names = [each.name for each in sampled_attributes(False, True, False, has_values=True)]
    assert {"primvars:values", "primvars:displayColor"} <= {*names}
    assert "primvars:values" not in [each.name for each in sampled_attributes(False, True, False)]


def test_ply_and_gltf_hold_the_values(exported: tuple[Shot, ExportedFrame], tmp_path: Path) -> None:
    shot, frame = exported
    write_ply(tmp_path / "a.ply", frame)
    header, _, _ = (tmp_path / "a.ply").read_bytes().partition(b"end_header")
    assert b"property float values" in header and b"property uchar red" in header
    write_glb(tmp_path / "a.glb", frame, shot.picture.look)
    content = (tmp_path / "a.glb").read_bytes()
    document = json.loads(content[20 : 20 + struct.unpack("<I", content[12:16])[0]])
    assert {"COLOR_0", "_VALUES", "_KNOWN"} <= document["meshes"][0]["primitives"][0]["attributes"].keys()
