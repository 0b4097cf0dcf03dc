"""Model files of the tests, as PLY."""

from __future__ import annotations

from pathlib import Path

import pytest

from flowsculpt.pipeline.mesh import TriangleMesh
from tests.needed_plugins import missing


def write_ply(mesh: TriangleMesh, path: Path) -> None:
    """Write a mesh as a text PLY that reads back as the same float64, with its attributes of one number.

    Skips the test where no plug-in reads it.
    """
    if missing("interchange"):
        pytest.skip("needs the plug-in interchange, which reads PLY")
    columns = [*mesh.vertices.T.tolist(), *(values.tolist() for values in mesh.attributes.values())]
    header = ["ply", "format ascii 1.0", f"element vertex {len(mesh.vertices)}"]
    header += [f"property double {name}" for name in ("x", "y", "z", *mesh.attributes)]
    header += [f"element face {len(mesh.faces)}", "property list uchar int vertex_indices", "end_header"]
    rows = [*zip(*columns, strict=True), *((3, *face) for face in mesh.faces.tolist())]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join([*header, *(" ".join(map(repr, row)) for row in rows), ""]), encoding="utf-8")
