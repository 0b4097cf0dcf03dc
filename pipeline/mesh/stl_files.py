"""Triangles in STL files, binary or text (3D Systems, StereoLithography Interface Specification, 1989)."""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Points
from pipeline.mesh.file_surface import FileSurface, early_end, file_surface
from render.base.plural import plural

_HEADER = 84
"""Bytes before the triangles of a binary file; the last four are their number."""

_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])

_MOST_TRIANGLES = 500_000_000
"""More triangles in a header are no number of triangles."""


def read_stl(content: bytes) -> FileSurface:
    """Read the triangles of an STL file; they share no vertices. Normals and colours are skipped.

    Raises ValueError for a file that ends early or has no numbers where coordinates belong.
    """
    points = _text_points(content.lower()) if _is_text(content) else _binary_points(content)
    return file_surface(points, np.arange(len(points)).reshape(-1, 3), base=None)


def _is_text(content: bytes) -> bool:
    """Tell text from a binary file, whose header may begin with `solid` too."""
    promised = int.from_bytes(content[80:_HEADER], "little")
    if len(content) == _HEADER + _TRIANGLE.itemsize * promised:
        return False
    start = content[:1024].lower()
    return start.lstrip().startswith(b"solid") and (b"facet" in start or len(content) < _HEADER)


def _binary_points(content: bytes) -> Points:
    if len(content) < _HEADER:
        raise ValueError(
            f"it ends early: it has {plural(len(content), 'byte')}, and its header alone needs 84"
        )
    promised = int.from_bytes(content[80:_HEADER], "little")
    present = (len(content) - _HEADER) // _TRIANGLE.itemsize
    if promised > _MOST_TRIANGLES:
        raise ValueError("it has no STL header")
    if present < promised:
        raise early_end(promised, "triangle", present)
    triangles = np.frombuffer(content, _TRIANGLE, promised, _HEADER)
    return triangles["corners"].reshape(-1, 3).astype(np.float64)


def _text_points(content: bytes) -> Points:
    if b"endsolid" not in content[-1024:]:
        present = content.count(b"endfacet")
        raise ValueError(f"it ends early: endsolid is missing after {plural(present, 'triangle')}")
    rows = [line.split() for line in content.splitlines()]
    points = [row[1:4] for row in rows if row[:1] == [b"vertex"]]
    if len(points) % 3:
        raise ValueError(f"it has {plural(len(points), 'vertex', 'vertices')}, which make no triangles")
    short = next((k for k, point in enumerate(points) if len(point) < 3), None)
    if short is not None:
        raise ValueError(f"vertex {short} has {len(points[short])} coordinates, not 3")
    return np.array([[float(word) for word in point] for point in points], np.float64).reshape(-1, 3)
