"""The formats `pc2` and `mdd` of the command `export`, and reports of formats that hold one mesh."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from flowsculpt import FrameError
from flowsculpt.api import plural
from flowsculpt.api.commands import print_result, progress_bars
from flowsculpt.api.frames import writing
from flowsculpt.api.options import DEFAULT_QUALITY, Common, Shot
from flowsculpt.pipeline.plugins.interchange.export_commands import OneMeshOptions, asked_for
from flowsculpt.pipeline.plugins.interchange.one_mesh import OneMesh
from flowsculpt.pipeline.plugins.interchange.point_caches import PointCacheExport
from flowsculpt.pipeline.plugins.interchange.unifying import Unification


def pc2(common: Common, shot: Shot, options: OneMeshOptions) -> None:
    """Write the motion of one mesh as a PC2 point cache, and the mesh as OBJ.

    `flowsculpt export pc2 A010_cube` writes renders/A010_cube/caches/A010_cube.pc2 and A010_cube.pc2.obj,
    whose vertices have the same order. Blender and Maya move the mesh by the cache; see docs/interchange.md.
    Of several subjects each has both files; `--subject heron` chooses one.
    """
    _caches(common, shot, options, "pc2")


def mdd(common: Common, shot: Shot, options: OneMeshOptions) -> None:
    """Write the motion of one mesh as an MDD point cache, and the mesh as OBJ.

    `flowsculpt export mdd A010_cube` writes renders/A010_cube/caches/A010_cube.mdd and A010_cube.mdd.obj,
    whose vertices have the same order. Blender and Cinema 4D move the mesh by the cache; see
    docs/interchange.md. Of several subjects each has both files; `--subject heron` chooses one.
    """
    _caches(common, shot, options, "mdd")


def _caches(common: Common, shot: str, options: OneMeshOptions, form: str) -> None:
    """Write the point caches of the subjects of a shot."""
    project, asked, folder = asked_for(common, shot, options, DEFAULT_QUALITY, "caches")
    parts = [Unification(part, project.store, options.vertices, options.until) for part in asked.parts]
    exports = [PointCacheExport(part, folder, form) for part in parts]
    if common.dry_run:
        report_unifying(common, [each.unification for each in exports if not each.is_current], str(folder))
        return
    started, words, facts = time.monotonic(), list[str](), list[dict[str, Any]]()
    with writing(common.root, common.wait), progress_bars(common.progress) as bar:
        for export in exports:
            with naming(export.unification):
                mesh = export.write(bar)
            shown = "it is current" if mesh is None else mesh_in_words(mesh)
            words.append(f"{export.path}: {shown}, in {time.monotonic() - started:.0f} s.")
            facts.append({"path": str(export.path), "written": export.files.written, **mesh_facts(mesh)})
    print_result("\n".join(words), facts[0] if len(facts) == 1 else facts, common.json)


def report_unifying(common: Common, parts: list[Unification], folder: str) -> None:
    """Report how many frames of one mesh of each subject would be refined, and where files would go."""
    counts = {part.name: len(part.missing()) for part in parts}
    lines = [
        f"{name}: refining {plural(count, 'frame')}, then writing to {folder}."
        for name, count in counts.items()
    ]
    print_result(
        "\n".join(lines) or "Nothing to be done.", {"refining": counts, "folder": folder}, common.json
    )


@contextmanager
def naming(part: Unification) -> Iterator[None]:
    """Have the errors of frames name their shot or subject."""
    try:
        yield
    except FrameError as error:
        raise FrameError(f"{part.name} {error}") from error


def mesh_in_words(mesh: OneMesh) -> str:
    """Return the size of a mesh, and what was left out, in words."""
    words = f"{plural(len(mesh.frames), 'frame')}, {len(mesh.rest)} "
    if mesh.reduction is not None:
        words += f"of {mesh.reduction.whole} "
    words += f"vertices, {plural(len(mesh.faces), 'triangle')}"
    if mesh.reduction is None:
        return words
    return f"{words}; the largest error is {mesh.reduction.error:.2f} edges, at frame {mesh.reduction.frame}"


def mesh_facts(mesh: OneMesh | None) -> dict[str, Any]:
    """Return the size of a mesh, and what was left out, as data."""
    if mesh is None:
        return {}
    facts = {"frames": list(mesh.frames), "vertices": len(mesh.rest), "triangles": len(mesh.faces)}
    left = mesh.reduction
    return facts if left is None else {**facts, "whole": left.whole, "error": left.error, "worst": left.frame}
