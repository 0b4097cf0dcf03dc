"""The table of stages: what each one makes, by which task, and which version its results have.

The version and the packages of a stage are part of the key of every file that it makes. Raise the version
when the same inputs give other results. The tests compare every stage with recorded results and fail until
you do.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.metadata import version
from typing import Any

from flowsculpt.pipeline.plugin import plugins


@dataclass(frozen=True)
class PipelineStage:
    """One stage of the way from a shot file to a film.

    name         the rule in the Snakefile (of still formats: `stills`), and the function of its task
    version      raised when the same inputs give other results
    doing        what it does, in the words of progress bars and reports
    makes        the kind of file in the store
    reads        the stages whose files it reads, as the Snakefile has them
    packages     distributions whose versions decide the results
    module       the module of `production.tasks` with its function; empty where commands do it
    function     the function; empty where it has the stage's name
    plugin       name and version of the plug-in that adds it
    per_quality  True if its files differ between qualities
    on_farm      True if a farm's nodes do its jobs; the others are too short to wait in a queue
    """

    name: str
    version: int
    doing: str
    makes: str
    reads: tuple[str, ...] = ()
    packages: tuple[str, ...] = ()
    module: str = ""
    function: str = ""
    plugin: tuple[str, str] | None = None
    per_quality: bool = True
    on_farm: bool = False

    @cached_property
    def recipe(self) -> dict[str, Any]:
        """Return the stage's name, its version, and those of its packages: its share of a key."""
        packages = {name: version(name) for name in self.packages}
        if self.plugin is not None:
            packages[f"plug-in {self.plugin[0]}"] = self.plugin[1]
        return {"stage": self.name, "version": self.version, **packages}

    @staticmethod
    def all() -> Mapping[str, PipelineStage]:
        """Return all stages by their names, those of plug-ins last."""
        return STAGES

    @property
    def shown_as(self) -> str:
        """The kind that says in which folder its files are shown: what it makes, or a plug-in's stage."""
        return self.name if self.plugin else self.makes


SIMULATE = PipelineStage(
    "simulate",
    version=10,
    packages=("numba", "numpy"),
    doing="simulating",
    makes="mesh",
    reads=("simulate",),  # of frames before, where another job makes them
    module="surfaces",
    per_quality=False,
    on_farm=True,
)
SMOOTH_NORMALS = PipelineStage(
    "smooth_normals",
    version=2,
    doing="smoothing",
    makes="normals",
    reads=("simulate",),
    module="surfaces",
    per_quality=False,
)
FRAME_CAMERA = PipelineStage(
    "frame_camera",
    version=2,
    doing="framing",
    makes="cameras",
    reads=("simulate",),
    module="surfaces",
    per_quality=False,
)
RENDER = PipelineStage(
    "render",
    version=11,
    packages=("mitsuba", "drjit", "OpenImageIO"),
    doing="rendering",
    makes="raw",
    reads=("smooth_normals", "frame_camera", "simulate"),
    module="render",
    on_farm=True,
)
PLUGIN_STAGES = tuple(
    PipelineStage(
        name,
        version=stage.version,
        packages=("OpenImageIO",),
        doing=stage.doing,
        makes="raw",
        module="finish",
        function="plugin_stage",
        plugin=(plugin.name, plugin.version),
        on_farm=True,
    )
    for name, (plugin, stage) in plugins().picture_stages.items()
    if not stage.is_last
)
"""The stages of plug-ins, in the order in which a shot that asks for several has them."""
PLUGIN_STAGES = tuple(
    replace(stage, reads=("render", *(before.name for before in PLUGIN_STAGES[:place])))
    for place, stage in enumerate(PLUGIN_STAGES)
)
FINISH = PipelineStage(
    "finish",
    version=6,
    packages=("pyoidn", "OpenImageIO"),
    doing="denoising",
    makes="frame",
    reads=("render", *(stage.name for stage in PLUGIN_STAGES)),
    module="finish",
    on_farm=True,
)
ASSEMBLE = PipelineStage(
    "assemble",
    version=1,
    packages=("av", "OpenImageIO"),
    doing="encoding",
    makes="movie",
    reads=("finish",),
    module="encoding",
)
FILM = PipelineStage(
    "film",
    version=3,
    packages=("av", "OpenImageIO"),
    doing="encoding the film",
    makes="movie",
    reads=("finish",),
    module="encoding",
)
STILLS = tuple(
    PipelineStage(
        form,
        version=1,
        packages=("OpenImageIO",),
        doing=doing,
        makes=form,
        reads=("finish",),
        module="encoding",
    )
    for form, doing in (("png", "writing PNG"), ("png16", "writing PNG"), ("jpeg", "writing JPEG"))
)

STAGES = {
    stage.name: stage
    for stage in (
        SIMULATE,
        SMOOTH_NORMALS,
        FRAME_CAMERA,
        RENDER,
        *PLUGIN_STAGES,
        FINISH,
        ASSEMBLE,
        FILM,
        *STILLS,
    )
}
"""The stages that jobs do, by name, each after those that it rests on."""


def forced_with(stages: Iterable[str]) -> frozenset[str]:
    """Return stages with all that read what they make, directly or not."""
    forced = set(stages)
    for stage in STAGES.values():  # in order
        if forced & set(stage.reads):
            forced.add(stage.name)
    return frozenset(forced)
