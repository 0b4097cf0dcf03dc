"""Models in FBX files, text or binary of any version, which ufbx reads in a process of its own.

ufbx is C that could crash on a damaged file; `fbx_reader` is the program of that process.
"""

from __future__ import annotations

import json
from importlib.util import find_spec
from pathlib import Path

from pipeline.errors import MachineError, MeshError
from pipeline.mesh.mesh_formats import FileSurface
from render.base.limited_process import answer_about_content, answer_of
from render.base.python_process import command_line

PACKAGE, EXTRA = "ufbx", "models"


def require_ufbx() -> None:
    """Raise MachineError where the package that reads FBX is not installed."""
    if find_spec(PACKAGE) is None:
        raise MachineError(
            f"FBX files need the package {PACKAGE} (4 MB), which is not installed; "
            f"pip install 'flowsculpt[{EXTRA}]', or only the package, for the Python of flowsculpt: "
            f"{command_line('pip', 'install', PACKAGE)}"
        )


def read_fbx(path: Path) -> FileSurface:
    """Read the visible meshes of an FBX file as one surface, in its coordinates and units.

    Axes other than y up and z up, both right-handed, are turned to y up. Raises MachineError without ufbx,
    ParserError or MeshError where it cannot be read.
    """
    require_ufbx()
    head, _, content = answer_of("pipeline.plugins.interchange.fbx_reader", path, "surface").partition(b"\n")
    if head:
        raise MeshError(json.loads(head)["fault"])
    return FileSurface.unpacked(content)


def up_of_fbx(path: Path, digest: str) -> str:
    """Return the axis that points up in the coordinates of `read_fbx`: y or z. The disk cache stores it.

    digest  of the file's content

    Raises as `read_fbx`.
    """
    require_ufbx()
    return answer_about_content("pipeline.plugins.interchange.fbx_reader", path, digest, PACKAGE, "up")
