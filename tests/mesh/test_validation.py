"""A mesh is proved sound, or its first fault is named with what to do about it."""

import numpy as np
import pytest

from flowsculpt.pipeline.errors import MeshError
from flowsculpt.pipeline.mesh import TriangleMesh, box, icosphere, rod, sheet, torus, validate

TETRAHEDRON = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)]
CORNERS = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]


@pytest.mark.parametrize(
    ("mesh", "euler", "closed"),
    [
        (TriangleMesh(CORNERS, TETRAHEDRON), 2, True),
        (box(edge_length=0.5), 2, True),
        (icosphere(3), 2, True),
        (rod(), 2, True),
        (torus(), 0, True),
        (sheet(edge_length=0.5), 1, False),
        (TriangleMesh(CORNERS[:3], [(0, 1, 2)]), 1, False),
    ],
    ids=["tetrahedron", "box", "icosphere", "rod", "torus", "sheet", "triangle"],
)
def test_sound_surfaces_are_sound_and_counted(mesh: TriangleMesh, euler: int, closed: bool) -> None:
    found = validate(mesh).require()
    assert found.sound
    assert found.euler == euler
    assert found.closed is closed
    assert 3 * found.faces == 2 * found.edges - found.boundary_edges


FAULTS = {
    "no faces": (CORNERS, np.empty((0, 3), int)),
    "vertex 3 is not finite": ([*CORNERS[:3], (0, 0, np.nan)], TETRAHEDRON),
    "names a vertex twice": (CORNERS, [*TETRAHEDRON[:3], (2, 0, 0)]),
    "vertex 4 belongs to no face": ([*CORNERS, (9, 9, 9)], TETRAHEDRON),
    "has 3 faces": ([*CORNERS, (1, 1, 1)], [*TETRAHEDRON, (0, 1, 4)]),
    "the same way": (CORNERS, [*TETRAHEDRON[:3], (0, 2, 3)]),
    "is there twice": (CORNERS, [*TETRAHEDRON, TETRAHEDRON[0]]),
    "on its back": (CORNERS[:3], [(0, 1, 2), (0, 2, 1)]),
    "vertex 0 joins two parts": (
        [*CORNERS, (-1, 0, 0), (0, -1, 0), (0, 0, -1)],
        [*TETRAHEDRON, (0, 4, 5), (0, 6, 4), (0, 5, 6), (4, 6, 5)],
    ),
    "vertex 2 joins two parts": ([*CORNERS, (2, 1, 0)], [(0, 1, 2), (2, 3, 4)]),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_every_fault_is_named(fault: str) -> None:
    mesh = TriangleMesh(*FAULTS[fault])
    assert not validate(mesh).sound
    with pytest.raises(MeshError, match=fault) as error:
        validate(mesh).require(name="statue.obj")
    assert str(error.value).startswith("statue.obj: ")
    assert "\n" not in str(error.value)


def test_a_sheet_is_refused_where_a_closed_surface_is_needed() -> None:
    with pytest.raises(MeshError, match="8 edges have a face on one side only"):
        validate(sheet(edge_length=1.0)).require(closed=True)
