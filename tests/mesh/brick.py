"""A brick of 2 × 3 × 1 units, as files of other programs write it: what each must be read as."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flowsculpt.pipeline.mesh import PolygonMesh
from flowsculpt.pipeline.mesh.read import ImportedSurface, ModelFile

SIZE = (2.0, 3.0, 1.0)
POINTS = [(x, y, z) for x in (0, 2) for y in (0, 3) for z in (0, 1)]
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
TRIANGLES = [(a, b, c) for a, b, c, d in QUADS] + [(a, c, d) for a, b, c, d in QUADS]


def rows(table: list[tuple[int, ...]], form: str = "{}") -> str:
    """Return a line for each row, its numbers separated by blanks."""
    return "".join(f"{form.format(' '.join(map(str, row)))}\n" for row in table)


OBJ = rows(POINTS, "v {}") + rows([tuple(v + 1 for v in quad) for quad in QUADS], "f {}")


def read(path: Path, content: bytes | str) -> ImportedSurface:
    """Return the surface of a file with this content."""
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return ModelFile(path).surface()


def require_brick(surface: ImportedSurface) -> PolygonMesh:
    """Return the mesh of a surface, which must be the brick: closed, facing outwards and without a repair."""
    mesh = surface.mesh
    assert not surface.repairs
    assert np.ptp(mesh.vertices, axis=0).tolist() == list(SIZE)
    assert len(mesh.vertices) == 8
    a, b, c = (mesh.triangulated().vertices[corner] for corner in mesh.triangulated().faces.T)
    assert np.isclose(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0, np.prod(SIZE))
    return mesh
