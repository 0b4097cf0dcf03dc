"""What a shot says of smoothing reaches the rendered surface, and nothing before it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.errors import ShotError
from pipeline.production.script import Script
from pipeline.production.take import Take
from pipeline.shot import read_shot

TINY = """\
title: A box, twisted
frames: 1-6
subject: {solid: box, size: [2, 2, 2]}
resample: {max_edge_length: 0.5}
"""


def take_of(text: str) -> Take:
    script = Script(text, Path("T010_tiny.yaml"))
    return Take(script, quality_name="preview", variant="none", requested=(1,))


def test_patches_change_the_picture_and_no_mesh() -> None:
    plain, smooth = take_of(TINY), take_of(TINY + "smooth: {tessellate: 3}\n")
    assert plain.shot.picture.tessellate == 1 and smooth.shot.picture.tessellate == 3
    assert plain.mesh_key(3) == smooth.mesh_key(3)
    assert plain.normals_key(3) != smooth.normals_key(3)


def test_a_number_of_pieces_that_cannot_be_is_told_with_its_place() -> None:
    with pytest.raises(ShotError, match=r"T010_tiny\.yaml:5:10: smooth.tessellate is 99"):
        read_shot("T010_tiny.yaml", TINY + "smooth: {tessellate: 99}\n")


def test_rendered_surfaces_are_cut_into_the_pieces_asked_for(studio) -> None:
    studio.shot.write_text(TINY + "smooth: {tessellate: 2}\n")
    done = studio.run("render", "T010_tiny", "-f", "1", "-q", "preview")
    assert done.code == 0, done.err
    home = studio.path / "renders" / "T010_tiny"
    with np.load(home / "meshes" / "T010_tiny.0001.npz") as mesh:
        faces = len(mesh["faces"])
        assert {"creases", "attribute:rest", "attribute:normal"} <= set(mesh.files)
    with np.load(home / "normals" / "T010_tiny.0001.npz") as normals:
        assert len(normals["faces"]) == 4 * faces
        np.testing.assert_allclose(np.linalg.norm(normals["normals"], axis=1), 1.0, atol=1e-6)
