"""The command `inks`, and the format `csv` of the command `export`."""

from collections.abc import Iterator

import numpy as np
import typer

from flowsculpt import TriangleMesh
from flowsculpt.api.commands import Project, execute, print_result, report_plan
from flowsculpt.api.files import atomic_write, disk_errors
from flowsculpt.api.frames import FrameStates, RenderRequest, StoredFiles
from flowsculpt.api.options import DEFAULT_QUALITY, Common, Frames, Shot, ShotOptions


def inks(common: Common) -> None:
    """List the inks of the look `marbling.inks`, as linear Rec.709.

    `flowsculpt inks`
    """
    from flowsculpt_marbling.inks import LAYERS

    lines = [f"{red:.3f} {green:.3f} {blue:.3f}" for red, green, blue in LAYERS.colours]
    print_result("\n".join(lines), {"inks": [list(colour) for colour in LAYERS.colours]}, common.json)


def csv(common: Common, shot: Shot, options: ShotOptions, frames: Frames = None) -> None:
    """Write a table of the vertices, faces and area of each frame's mesh, simulating what is missing.

    `flowsculpt export csv M010_comb -f 1-24` writes renders/M010_comb/csv/M010_comb.csv.
    """
    project = options.project(common)
    request = project.find_request(shot, DEFAULT_QUALITY, frames, FrameStates.of_meshes, variant="none")
    if common.dry_run:
        report_plan(common, project.mesh_frames(request))
        return
    code = execute(common, lambda: project.mesh_frames(request)).exit_code
    rows = [
        "frame,vertices,faces,area",
        *(_row(number, meshes) for number, meshes in _stored(project, request)),
    ]
    path = common.root / request.folders.home / "csv" / f"{request.name}.csv"
    with disk_errors(path), atomic_write(path) as draft:
        draft.write_text("\n".join(rows) + "\n", encoding="utf-8")
    print_result(f"{path}: written.", {"path": str(path)}, common.json)
    raise typer.Exit(code)


def _stored(project: Project, request: RenderRequest) -> Iterator[tuple[int, list[TriangleMesh]]]:
    """Yield number and surfaces, one for each subject, of frames that are stored, not of failed ones."""
    for number in request.requested:
        keys = [(part, part.keys.mesh(number)) for part in request.parts]
        if all(project.store.holds("mesh", key) for _, key in keys):
            reader = StoredFiles("mesh").reader
            frames = [
                project.store.read("mesh", key, part.place("mesh", number), reader(key, number=number))
                for part, key in keys
            ]
            yield number, [frame.mesh for frame in frames]


def _row(number: int, meshes: list[TriangleMesh]) -> str:
    """Return the number, vertices, faces and area of a frame, separated by commas."""
    corners = np.concatenate([mesh.vertices[mesh.faces] for mesh in meshes])
    first, second, third = corners.swapaxes(0, 1)
    area = np.linalg.norm(np.cross(second - first, third - first), axis=1).sum() / 2.0
    return f"{number},{sum(len(mesh.vertices) for mesh in meshes)},{len(corners)},{area:.6f}"
