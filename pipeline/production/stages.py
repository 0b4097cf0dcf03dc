"""The table of stages: what each one makes, by which task, and which version its results have.

The version and the packages of a stage are part of the key of every file that it makes. Raise the version
when the same inputs give other results. The tests compare every stage with recorded results and fail until
you do.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import version
from typing import Any


@dataclass(frozen=True)
class PipelineStage:
    """One stage of the way from a shot file to a film.

    name         the rule in the Snakefile, and the function in `pipeline.production.tasks`
    version      raised when the same inputs give other results
    packages     distributions whose versions decide the results
    doing        what it does, in the words of progress bars and reports
    makes        the kind of file in the store
    module       the module of `pipeline.production.tasks` with its function; empty where commands do it
    per_frame    True if it makes one file a frame
    per_quality  True if its files differ between qualities
    on_farm      True if a farm's nodes do its jobs; the others are too short to wait in a queue
    """

    name: str
    version: int
    packages: tuple[str, ...]
    doing: str
    makes: str
    module: str = ""
    per_frame: bool = False
    per_quality: bool = True
    on_farm: bool = False

    @cached_property
    def recipe(self) -> dict[str, Any]:
        """Return the stage's name, its version, and those of its packages: its share of a key."""
        packages = {name: version(name) for name in self.packages}
        return {"stage": self.name, "version": self.version, **packages}


SIMULATE = PipelineStage(
    "simulate",
    version=1,
    packages=("numba", "numpy", "trimesh"),
    doing="simulating",
    makes="mesh",
    module="meshes",
    per_frame=True,
    per_quality=False,
    on_farm=True,
)
SMOOTH_NORMALS = PipelineStage(
    "smooth_normals",
    version=1,
    packages=(),
    doing="smoothing",
    makes="normals",
    module="meshes",
    per_frame=True,
    per_quality=False,
)
FRAME_CAMERA = PipelineStage(
    "frame_camera",
    version=1,
    packages=(),
    doing="framing",
    makes="cameras",
    module="meshes",
    per_quality=False,
)
RENDER = PipelineStage(
    "render",
    version=1,
    packages=("mitsuba", "drjit", "OpenImageIO"),
    doing="rendering",
    makes="raw",
    module="render",
    per_frame=True,
    on_farm=True,
)
FINISH = PipelineStage(
    "finish",
    version=1,
    packages=("pyoidn", "OpenImageIO"),
    doing="denoising",
    makes="frame",
    module="finish",
    per_frame=True,
    on_farm=True,
)
ASSEMBLE = PipelineStage(
    "assemble",
    version=1,
    packages=("av", "OpenImageIO"),
    doing="encoding",
    makes="movie",
    module="encode",
)
FILM = PipelineStage(
    "film",
    version=1,
    packages=("av", "OpenImageIO"),
    doing="encoding the film",
    makes="movie",
    module="encode",
)
STILLS = tuple(
    PipelineStage(
        form,
        version=1,
        packages=("OpenImageIO",),
        doing=doing,
        makes=form,
        module="encode",
        per_frame=True,
    )
    for form, doing in (("png", "writing PNG"), ("png16", "writing PNG"), ("jpeg", "writing JPEG"))
)

STAGES = {
    stage.name: stage
    for stage in (SIMULATE, SMOOTH_NORMALS, FRAME_CAMERA, RENDER, FINISH, ASSEMBLE, FILM, *STILLS)
}
"""The stages that jobs do, by name, each after those that it rests on."""

DELIVER = PipelineStage(
    "deliver", version=1, packages=("av", "OpenImageIO"), doing="encoding deliverables", makes="movie"
)
TURNTABLE_SHEET = PipelineStage(
    "turntable_sheet", version=1, packages=("av", "OpenImageIO"), doing="laying out sheets", makes="png"
)
MEASURE = PipelineStage(
    "measure", version=1, packages=(), doing="measuring", makes="measures", per_quality=False
)

READS = {
    "simulate": ("simulate",),
    "smooth_normals": ("simulate",),
    "frame_camera": ("simulate",),
    "render": ("smooth_normals", "frame_camera", "simulate"),
    "finish": ("render",),
    "assemble": ("finish",),
    "film": ("finish",),
    **dict.fromkeys((stage.name for stage in STILLS), ("finish",)),
}
"""The stages that a stage reads, as the Snakefile has them; a simulation may go on from another."""


def forced_with(stages: Iterable[str]) -> frozenset[str]:
    """Return stages with all that read what they make, directly or not."""
    forced = set(stages)
    for stage, read in READS.items():  # in order
        if forced & set(read):
            forced.add(stage)
    return frozenset(forced)
