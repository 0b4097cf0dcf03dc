"""The formats `gltf`, `abc`, `vat` and `web` of the command `export`: animations with one mesh."""

from __future__ import annotations

import time
from typing import Annotated, Any

import typer

from flowsculpt.api import plural
from flowsculpt.api.commands import execute, print_result, progress_bars, report_plan, size_words
from flowsculpt.api.frames import Locks
from flowsculpt.api.options import DEFAULT_QUALITY, Common, Shot
from flowsculpt.pipeline.plugins.interchange.alembic_files import require_alembic
from flowsculpt.pipeline.plugins.interchange.animation_export import (
    AlembicExport,
    AnimationExport,
    GltfExport,
    VertexTextureExport,
    WebExport,
)
from flowsculpt.pipeline.plugins.interchange.copy_instances import require_rigid
from flowsculpt.pipeline.plugins.interchange.export_commands import OneMeshOptions, asked_for
from flowsculpt.pipeline.plugins.interchange.gltf_instances import GltfInstancesExport
from flowsculpt.pipeline.plugins.interchange.one_mesh import OneMesh
from flowsculpt.pipeline.plugins.interchange.unifying import Unification
from flowsculpt.pipeline.plugins.interchange.web_player import require_three_js

Plain = Annotated[
    bool,
    typer.Option(
        "--plain",
        help="Write floats without extensions, for programs that lack these; about four times as large.",
    ),
]

Instances = Annotated[
    bool, typer.Option("--instances", help="Write rigid copies as nodes that share a mesh.")
]


def gltf(
    common: Common, shot: Shot, options: OneMeshOptions, plain: Plain = False, instances: Instances = False
) -> None:
    """Write the sculpture with its motion as one glTF file, for pages, viewers and DCC programs.

    `flowsculpt export gltf A010_cube` writes renders/A010_cube/models/A010_cube.glb: one mesh, with morph
    targets at as few keyframes as keep each frame within a quarter of an edge. It is compressed with
    EXT_meshopt_compression, which pages want, and three.js, Babylon.js, model-viewer and Blender from 5.2
    read. For Blender before that and other programs, `--plain` writes a file that all read, about four times
    as large. Pictures of the look are in the file, compressed ones with at most 2048 pixels on a side.
    With `--instances` rigid copies are nodes that share a mesh, in NAME.instances.glb.
    """
    project, asked, folder = asked_for(common, shot, options, DEFAULT_QUALITY, "models")
    parts = options.unifications(asked, project)
    if instances:
        require_rigid(parts)
        _export(common, [GltfInstancesExport(asked, project.store, folder, parts, plain)])
        return
    _export(common, [GltfExport(asked, project.store, folder, parts, plain)])


def abc(common: Common, shot: Shot, options: OneMeshOptions) -> None:
    """Write the sculpture with its motion as one Alembic file, for Blender, Maya, Houdini and Cinema 4D.

    `flowsculpt export abc A010_cube` writes renders/A010_cube/models/A010_cube.abc: one mesh of each subject,
    with its normals and texture coordinates, at each frame. It needs the package alembic3d.
    """
    require_alembic()
    project, asked, folder = asked_for(common, shot, options, DEFAULT_QUALITY, "models")
    parts = options.unifications(asked, project)
    _export(common, [AlembicExport(asked, project.store, folder, parts)])


def vat(common: Common, shot: Shot, options: OneMeshOptions) -> None:
    """Write vertex animation textures for Unreal, Unity and Godot, with the mesh that they move.

    `flowsculpt export vat A010_cube` writes to renders/A010_cube/vat: the mesh as GLB, positions as EXR,
    normals as PNG, and JSON with bounds, rate and layout; docs/interchange.md has shaders. Of several
    subjects each has files; `--subject heron` chooses one.
    """
    project, asked, folder = asked_for(common, shot, options, DEFAULT_QUALITY, "vat")
    _export(
        common,
        [
            VertexTextureExport(mesh.request, project.store, folder, (mesh,))
            for mesh in options.unifications(asked, project)
        ],
    )


def web(common: Common, shot: Shot, options: OneMeshOptions) -> None:
    """Write a page that plays the sculpture in three dimensions: one file, without a network.

    `flowsculpt export web A010_cube` writes renders/A010_cube/web/A010_cube.html, with orbit, scrubbing, the
    shot's camera, light and look. The frames are simulated first where their cameras are missing. Put it in a
    page of your own by an iframe of `A010_cube.html#bare`, without the bar.
    """
    require_three_js()
    project, asked, folder = asked_for(common, shot, options, DEFAULT_QUALITY, "web")
    parts = options.unifications(asked, project)
    if common.dry_run:
        report_plan(common, project.geometry(asked))
        if not common.json:
            _report_unifying(common, list(parts), str(folder))
        return
    outcome = execute(common, lambda: project.geometry(asked))
    _export(common, [WebExport(asked, project.store, folder, parts)])
    raise typer.Exit(outcome.exit_code)


def _export(common: Common, exports: list[AnimationExport]) -> None:
    """Write the files that are not current, and report them."""
    if common.dry_run:
        stale = [part for export in exports if not export.is_current for part in export.parts]
        _report_unifying(common, stale, str(exports[0].folder))
        return
    words, facts = list[str](), list[dict[str, Any]]()
    with Locks(common.root).hold_with_writers(common.wait), progress_bars(common.progress) as bar:
        for export in exports:
            started = time.monotonic()
            done = export.write(bar)
            shown, known = "it is current", dict[str, Any]()
            if done is not None:
                meshes, held = done
                shown = "; ".join([*map(_mesh_in_words, meshes), held])
                known = {"subjects": [_mesh_facts(mesh) for mesh in meshes], "held": held}
            seconds = time.monotonic() - started
            words.append(f"{export.path}: {shown}, {size_words(export.bytes)}, in {seconds:.0f} s.")
            words += [export.readers] if export.readers else []
            known |= {"path": str(export.path), "written": export.files.written, "bytes": export.bytes}
            facts.append(known | {"seconds": round(seconds, 2)})
    print_result("\n".join(words), facts[0] if len(facts) == 1 else facts, common.json)


def _report_unifying(common: Common, parts: list[Unification], folder: str) -> None:
    """Report how many frames of one mesh of each subject would be refined, and where files would go."""
    counts = {part.name: len(part.missing()) for part in parts}
    lines = [
        f"{name}: refining {plural(count, 'frame')}, then writing to {folder}."
        for name, count in counts.items()
    ]
    print_result(
        "\n".join(lines) or "Nothing to be done.", {"refining": counts, "folder": folder}, common.json
    )


def _mesh_in_words(mesh: OneMesh) -> str:
    """Return the size of a mesh, and what was left out, in words."""
    words = f"{plural(len(mesh.frames), 'frame')}, {len(mesh.rest)} "
    if mesh.reduction is not None:
        words += f"of {mesh.reduction.whole} "
    words += f"vertices, {plural(len(mesh.faces), 'triangle')}"
    if mesh.reduction is None:
        return words
    return f"{words}; the largest error is {mesh.reduction.error:.2f} edges, at frame {mesh.reduction.frame}"


def _mesh_facts(mesh: OneMesh | None) -> dict[str, Any]:
    """Return the size of a mesh, and what was left out, as data."""
    if mesh is None:
        return {}
    facts = {"frames": list(mesh.frames), "vertices": len(mesh.rest), "triangles": len(mesh.faces)}
    left = mesh.reduction
    return facts if left is None else {**facts, "whole": left.whole, "error": left.error, "worst": left.frame}
