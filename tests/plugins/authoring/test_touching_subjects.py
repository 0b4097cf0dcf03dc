"""Subjects of the gallery that are to touch do so, and do not cut each other."""

from itertools import islice

import numpy as np
import pytest

from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.arrays import Points
from flowsculpt.pipeline.mesh import TriangleMesh
from flowsculpt.pipeline.plugins.authoring.gallery_shots import GALLERY
from flowsculpt.pipeline.shot import read_shot
from flowsculpt.pipeline.statistics import self_intersections


def crossings(one: TriangleMesh, other: TriangleMesh, points: Points) -> int:
    """Return how many faces of a mesh intersect those of another, whose vertices are at the points."""
    vertices, faces = np.concatenate([one.vertices, points]), [one.faces, other.faces + len(one.vertices)]
    both = TriangleMesh(vertices, np.concatenate(faces).astype(np.int32))
    return self_intersections(both) - self_intersections(one) - self_intersections(other)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shot", "frame", "touching", "touched", "scale", "shift"),
    [
        ("B120_pillars", 60, "ring", ("red", "pale"), (0.99, 1.0, 0.99), (0.0, 0.0, 0.0)),
        ("B230_duet", 49, "slender", ("stout",), (1.0, 1.0, 1.0), (-0.01, 0.0, 0.0)),
    ],
)
def test_subjects_touch_and_neither_cuts_the_other(shot, frame, touching, touched, scale, shift):
    """A hundredth of a unit nearer they would."""
    subjects = read_shot(GALLERY / f"{shot}.yaml")
    at = {
        name: next(islice(animate(subjects.of_subject(name)), frame - 1, None)).mesh
        for name in (touching, *touched)
    }
    mesh = at[touching]
    for name in touched:
        assert crossings(at[name], mesh, mesh.vertices) == 0
        assert crossings(at[name], mesh, mesh.vertices * scale + shift) > 0
