"""The command `resample`: resample one mesh file."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Group
from rich.table import Table

from flowsculpt import (
    Chord,
    Curved,
    MeshError,
    PolygonMesh,
    Report,
    Thresholds,
    TriangleMesh,
    UsageError,
    mesh_statistics,
)
from flowsculpt import (
    resample as resample_triangles,
)
from flowsculpt.api import PolygonMethod, plugins, plural
from flowsculpt.api.commands import empty_table, print_result, print_warning, require_one_of
from flowsculpt.api.meshes import ModelFile
from flowsculpt.api.options import Common
from flowsculpt.pipeline.plugins.interchange.mesh_writers import WRITERS, write_mesh

_POLYGON_METHODS = plugins().classes("resamplers", PolygonMethod)
METHODS = ("triangles", *_POLYGON_METHODS)
PLACEMENTS = {"chord": Chord(), "curved": Curved()}
SPLITS = ("edges", "faces")

REFUSALS = {
    "link": "two parts of the surface would touch",
    "boundary": "two boundaries would meet, or a triangle between them vanish",
    "feature": "two corners or two creases would become one",
    "too_long": "an edge over the maximum would appear",
    "fold": "a face would turn over or become a sliver",
    "shape": "the tip of something thin would be lost",
    "crowded": "an end has too many neighbours",
    "area": "the faces beside it are large enough",
}


def resample(
    common: Common,
    source: Annotated[
        Path,
        typer.Argument(metavar="IN", help="The mesh to read: OBJ, PLY, STL, OFF, GLB, FBX, DAE, 3MF or USD."),
    ],
    target: Annotated[Path, typer.Argument(metavar="OUT", help=f"Where to write it: {', '.join(WRITERS)}.")],
    max_edge_length: Annotated[
        float,
        typer.Option(
            metavar="LENGTH", help="Split longer edges, in units of the file. No edge stays longer."
        ),
    ],
    min_edge_length: Annotated[
        float | None,
        typer.Option(
            metavar="LENGTH",
            help="Collapse shorter edges where the shape allows. Must be below half the maximum; 0 collapses "
            "none. Default: 40% of the maximum.",
        ),
    ] = None,
    hard_angle_degrees: Annotated[
        float, typer.Option(metavar="ANGLE", help="Keep edges that turn by more, in degrees, as creases.")
    ] = 40.0,
    placement: Annotated[
        str | None,
        typer.Option(
            metavar="PLACEMENT",
            help="Where new vertices go. chord: the middle of the edge, the default. curved: a smooth "
            "surface through the old vertices, which ends at creases.",
        ),
    ] = None,
    method: Annotated[
        str,
        typer.Option(
            metavar="METHOD", help="triangles; or polyhedra, which slices faces of any number of sides."
        ),
    ] = "triangles",
    splits: Annotated[
        str | None,
        typer.Option(
            metavar="SPLITS",
            help="edges: cut long edges in two, the default. faces: cut faces with a long edge into four, "
            "which keeps their shapes and gives more of them.",
        ),
    ] = None,
) -> None:
    """Resample one mesh file: split long edges, collapse short ones, keep creases and the shape.

    `flowsculpt resample bunny.obj even.ply --max-edge-length 0.02` writes even.ply. Choose the length by the
    smallest detail to keep; half the length gives four times the faces. An edge that cannot collapse without
    harm to the surface stays short, and is counted by the reason.
    """
    _check_options(method, placement, splits)
    if target.suffix.lstrip(".").lower() not in WRITERS:
        raise MeshError(
            f"{target}: {target.suffix or 'no suffix'} cannot be written; use one of {', '.join(WRITERS)}"
        )
    if not 0 < hard_angle_degrees <= 180:
        raise UsageError(f"--hard-angle-degrees {hard_angle_degrees:g} must be above 0 and at most 180")
    thresholds = Thresholds(max_edge_length, min_edge_length, math.radians(hard_angle_degrees))
    imported = ModelFile(source).surface()
    before = imported.mesh
    for line in imported.warnings:
        print_warning(f"{source}: {line}")
    if common.dry_run:
        facts = {"in": str(source), "out": str(target), "vertices": len(before.vertices)}
        print_result(
            f"{target}: would be written, from {plural(len(before.vertices), 'vertex', 'vertices')}.",
            facts,
            common.json,
        )
        return
    after: TriangleMesh | PolygonMesh
    report: Report
    if method != "triangles":
        slicer = _POLYGON_METHODS[method]().begin(before, thresholds)
        report = slicer.resample()
        after = slicer.mesh
    else:
        after, report = resample_triangles(
            *(before.triangulated(), thresholds, PLACEMENTS[placement or "chord"]),
            splits="faces" if splits == "faces" else "edges",
        )
    write_mesh(after, target)
    facts = {"in": str(source), "out": str(target), **_facts(before, after, report)} if common.json else {}
    print_result(Group(_listing(before, report), f"{target}: written."), facts, common.json)


def _check_options(method: str, placement: str | None, splits: str | None) -> None:
    """Raise UsageError for unknown words and for options that exclude each other."""
    require_one_of(method, METHODS, f"--method {method!r} is not known.")
    require_one_of(placement or "chord", PLACEMENTS, f"--placement {placement!r} is not known.")
    require_one_of(splits or "edges", SPLITS, f"--splits {splits!r} is not known.")
    for option, word in (("placement", placement), ("splits", splits)):
        if method != "triangles" and word:
            raise UsageError(
                f"--{option} is for triangles; {method} are cut by planes. Leave one of them out."
            )
    if splits == "faces" and placement == "curved":
        raise UsageError(
            "--splits faces puts new vertices in the middle of their edges, and --placement curved does not. "
            "Leave one of them out."
        )


def _facts(before: PolygonMesh, after: TriangleMesh | PolygonMesh, report: Report) -> dict[str, Any]:
    triangles = after if isinstance(after, TriangleMesh) else after.triangulated()
    return {
        **vars(report),
        "refused": dict(report.refused),
        "within_limits": report.within_limits,
        "before": asdict(mesh_statistics(before.triangulated())),
        "after": asdict(mesh_statistics(triangles)),
    }


def _listing(before: PolygonMesh, report: Report) -> Table:
    rows = [
        ("vertices", f"{len(before.vertices)} → {report.vertices}"),
        ("faces", f"{len(before)} → {report.faces}"),
        ("splits", str(report.splits)),
        ("collapses", str(report.collapses)),
        ("edges within limits", f"{report.within_limits:.2%} of {report.edges}"),
        ("edge lengths", f"{report.shortest:.4g} to {report.longest:.4g}"),
    ]
    for reason, count in report.refused.items():
        rows.append(("kept though short", f"{count}: {REFUSALS[reason]}"))
    listing = empty_table("", "")
    listing.show_header = False
    for row in rows:
        listing.add_row(*row)
    return listing
