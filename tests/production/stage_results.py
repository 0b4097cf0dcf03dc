"""Make a tiny film and gather what every stage makes of it.

`python -m tests.production.stage_results` records it: do so after raising the version of a stage in
`pipeline/production/stages.py`.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
from collections.abc import Iterator, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import av
import llvmlite.binding as llvm
import numpy as np

from flowsculpt.pipeline.plugin import named
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.request.lookup import Show
from flowsculpt.pipeline.production.stages import STAGES, STILLS, PipelineStage
from flowsculpt.pipeline.production.store import readers
from flowsculpt.render.post.image import read_exr, read_png
from tests.conftest import commanded, done
from tests.needed_plugins import missing

Arrays = dict[str, np.ndarray]

RECORD = Path(__file__).with_name("reference") / "stage_results.npz"

OF_PLUGINS = {
    "delivery": "deliverables:DELIVER",
    "turntable": "turntable_movie:TURNTABLE_SHEET",
    "review": "measures:MEASURE",
}
"""Stages of plug-ins."""

EVERY_STAGE: tuple[PipelineStage, ...] = (
    *STAGES.values(),
    *(
        named(f"flowsculpt.pipeline.plugins.{plugin}.{place}")
        for plugin, place in OF_PLUGINS.items()
        if not missing(plugin)
    ),
)
"""Each after those that it rests on."""

NAME = "R010_reference"
SHOT = """\
title: Reference
frames: 1-3
subject: {solid: box, size: [2, 2, 2]}
resample: {max_edge_length: 0.5}
flows:
  - twist: {axis: y, amount: {ease: linear, keys: {1: 0, 3: 40}}}
look: glaze
camera: {azimuth: -30, elevation: 14}
shutter: {angle: 180}
quality: {draft: {samples: 4, auxiliary_samples: 1, denoise: fast, temporal_denoise: 1}}
"""
FILM = f"""\
title: Reference
subtitle: three frames
title_seconds: 0.25
credits_seconds: 0
shots: [{NAME}, {{shot: {NAME}, dissolve: 2}}]
"""
SCALE = "6.7%"
QUALITY = "draft.scale6.7"
"""32 × 18 pixels."""


def results(root: Path) -> dict[str, Arrays]:
    """Make a film under `root`, which is the working folder, and return arrays by stage, in their order."""
    (root / "shots").mkdir()
    (root / "shots" / f"{NAME}.yaml").write_text(SHOT)
    (root / "shots" / "film.yaml").write_text(FILM)
    project = Project(root, 1)
    done(root, project.film(QUALITY))
    for stage in STILLS:
        done(root, project.stills([NAME], stage.name, QUALITY))
    request = project.request(Show().find_shot(NAME), QUALITY)
    keys, numbers = request.keys.pictures(project.store), sorted(request.requested)
    assert keys is not None
    meshes = {
        n: readers.mesh_frame(request.keys.mesh(n), n)(root / request.place("mesh", n)) for n in numbers
    }
    gathered: dict[str, Arrays] = {
        "simulate": {
            f"{name}.{n}": array
            for n, frame in meshes.items()
            for name, array in (("vertices", frame.mesh.vertices), ("faces", frame.mesh.faces))
        },
        "smooth_normals": {
            f"{name}.{n}": array
            for n in numbers
            for name, array in readers.arrays(request.keys.normals(n))(
                root / request.place("normals", n)
            ).items()
            if name != "key"
        },
        "frame_camera": _numbers(json.loads((root / request.folders.cameras()).read_text())),
        "render": {
            f"{name}.{n}": array
            for n in numbers
            for name, array in read_exr(root / request.place("raw", n))[0].arrays.items()
        },
        "finish": {f"{n}": read_exr(root / request.place("frame", n))[0]["beauty"] for n in numbers},
        **{s.name: {f"{n}": read_png(root / request.place(s.name, n)) for n in numbers} for s in STILLS},
        "assemble": _decoded(root / request.movie_path),
        "film": _decoded(root / "renders" / "film" / QUALITY / "film.mp4"),
    }
    if not missing("delivery"):
        gathered["deliver"] = _delivered(root)
    if not missing("turntable"):
        gathered["turntable_sheet"] = _turned(project)
    if not missing("review"):
        gathered["measure"] = _measured(meshes)
    return {stage.name: gathered[stage.name] for stage in EVERY_STAGE}


def _delivered(root: Path) -> Arrays:
    code, said = commanded(root, "deliver", NAME, "--as", "prores4444", "-q", "draft", "--scale", SCALE)
    assert code == 0, said
    return _decoded(next((root / "renders").rglob("*.mov")))


def _turned(project: Project) -> Arrays:
    from flowsculpt.pipeline.plugins.turntable.turntable_movie import TurntableRequest, TurntableSheets

    turning = TurntableRequest(project, NAME, QUALITY, 2, 4, turn="object")
    done(project.root, turning.plan())
    (sheet,) = TurntableSheets(turning).draw()
    return {"sheet": read_png(project.root / sheet)}


def _measured(meshes: Mapping[int, Any]) -> Arrays:
    from flowsculpt.pipeline.plugins.review.measures import measures_of

    return _numbers({n: measures_of(frame, 0.5) for n, frame in meshes.items()})


def environment() -> dict[str, Any]:
    """Return what decides the last bits: variant, features of the processor, packages of the stages."""
    packages = sorted({name for stage in EVERY_STAGE for name in stage.packages})
    root = Path.cwd()
    return {
        "variant": Project(root, 1).request(Show().find_shot(NAME), QUALITY).variant,
        "features": sorted(name for name, has in llvm.get_host_cpu_features().items() if has),
        "packages": {name: version(name) for name in packages},
    }


def _decoded(path: Path) -> Arrays:
    with av.open(str(path)) as container:
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    return {"frames": np.stack(frames)}


def _numbers(data: Any) -> Arrays:
    """Return all numbers of plain data, in the order in which they stand."""

    def each(part: Any) -> Iterator[float]:
        if isinstance(part, dict | list | tuple):
            for inner in part.values() if isinstance(part, dict) else part:
                yield from each(inner)
        elif isinstance(part, int | float):
            yield float(part)

    return {"numbers": np.array(list(each(data)))}


def record() -> None:
    """Write the results of today, with the versions of the stages and the environment they came from."""
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        found = results(Path(folder))
        about = {"stages": {stage.name: stage.version for stage in EVERY_STAGE}, **environment()}
    arrays = {f"{stage}/{name}": array for stage, named in found.items() for name, array in named.items()}
    RECORD.parent.mkdir(exist_ok=True)
    np.savez_compressed(RECORD, about=np.array(json.dumps(about)), **arrays)
    print(f"{RECORD}: {RECORD.stat().st_size / 1024:.0f} KiB", file=sys.stderr)


if __name__ == "__main__":
    record()
