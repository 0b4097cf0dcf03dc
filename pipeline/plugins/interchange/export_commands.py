"""The formats `usd`, `ply`, `obj`, `glb` and `stl` of the command `export`: shots for other 3-D programs."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flowsculpt import FrameError, UsageError
from flowsculpt.api import plural
from flowsculpt.api.commands import (
    Project,
    execute,
    print_error,
    print_result,
    progress_bars,
    report_plan,
)
from flowsculpt.api.frames import FrameStates, Locks, RenderRequest
from flowsculpt.api.options import DEFAULT_QUALITY, Common, Frames, Quality, Shot, ShotOptions, shared_option
from flowsculpt.pipeline.plugins.interchange.model_export import LONGEST_SIDE, ModelExport, require_still
from flowsculpt.pipeline.plugins.interchange.usd_files import require_usd

if TYPE_CHECKING:
    from flowsculpt.pipeline.plugins.interchange.unifying import Unification
    from flowsculpt.pipeline.plugins.interchange.usd_export import UsdExport

Folder = Annotated[
    Path | None,
    shared_option("output", "Write to this folder. Default: a folder in renders/SHOT.", metavar="DIR"),
]


@dataclass(frozen=True)
class ModelOptions(ShotOptions):
    """Options of formats that hold meshes."""

    output: Folder = None
    frames: Frames = None
    subject: Annotated[
        str | None,
        typer.Option("--subject", metavar="NAME", help="One of the shot's subjects, if it has several."),
    ] = None


@dataclass(frozen=True)
class OneMeshOptions(ModelOptions):
    """Options of formats that hold one mesh for all frames."""

    vertices: Annotated[
        int | None,
        typer.Option(min=4, metavar="N", help="Leave out the vertices that show least, until N are left."),
    ] = None
    until: Annotated[
        float | None,
        typer.Option(
            min=0.0, metavar="E", help="Leave out vertices whose error is below E, in edge lengths: 0.1."
        ),
    ] = None
    tolerance: Annotated[
        float | None,
        typer.Option(
            min=0.01,
            max=10.0,
            metavar="E",
            help="Of a sequence whose faces change: how far, in its median edges, the mesh may be from it. "
            "Default: 0.25.",
        ),
    ] = None
    carry_from: Annotated[
        int | None,
        typer.Option(
            "--carry-from",
            metavar="N",
            help="Of such a sequence: the frame whose mesh is carried through all others. Default: the "
            "middle one.",
        ),
    ] = None

    def unifications(self, asked: RenderRequest, project: Project) -> tuple[Unification, ...]:
        """Return how one mesh of each subject is made."""
        from flowsculpt.pipeline.plugins.interchange.unifying import Unification

        return tuple(
            Unification(
                *(part, project.store, self.vertices, self.until),
                tolerance=self.tolerance,
                carry_from=self.carry_from,
            )
            for part in asked.parts
        )

    @property
    def changes_one_mesh(self) -> bool:
        """True if an option asks for another mesh than the usual one."""
        options = self.vertices, self.until, self.tolerance, self.carry_from
        return any(option is not None for option in options)


OneMesh = Annotated[
    bool,
    typer.Option(
        "--one-mesh", help="Write one mesh whose vertices move, which programs blend between frames."
    ),
]


def usd(
    common: Common,
    shot: Shot,
    options: OneMeshOptions,
    one_mesh: OneMesh = False,
    instances: Annotated[
        bool, typer.Option("--instances", help="Write rigid copies as instances of one shape.")
    ] = False,
    quality: Quality = DEFAULT_QUALITY,
) -> None:
    """Write the sculpture with its motion, camera and lights as a USD stage.

    `flowsculpt export usd A010_cube` writes renders/A010_cube/usd/A010_cube.usda, which Houdini, Blender and
    usdview open, and a clip for each frame: the mesh with velocities, normals and rest positions. Missing
    frames are simulated first. Later exports write only clips that changed. With `--one-mesh` the stage is
    A010_cube.one_mesh.usda, whose mesh has the same triangles in all frames. With `--instances` rigid copies
    are a point instancer, in NAME.instances.usda. It needs the package usd-core; see docs/interchange.md.
    """
    project, asked, folder = asked_for(common, shot, options, quality, "usd")
    if asked.source.subject:
        raise UsageError(
            f"--subject {asked.source.subject}: a USD stage holds all subjects of {asked.name}, each as a "
            "prim. Leave out --subject"
        )
    require_usd()
    if one_mesh and instances:
        raise UsageError("--one-mesh and --instances are two ways to write copies; choose one")
    if one_mesh or (instances and not options.changes_one_mesh):
        _one_mesh_stage(common, project, asked, folder, options, instances)
        return
    if options.changes_one_mesh:
        remedy = "leave them out with --instances" if instances else "add --one-mesh"
        raise UsageError(f"--vertices, --until, --tolerance and --carry-from change one mesh; {remedy}")
    from flowsculpt.pipeline.plugins.interchange.usd_export import UsdExport

    _export(common, project, asked, [UsdExport(asked, project.store, folder)])


def _one_mesh_stage(
    common: Common,
    project: Project,
    asked: RenderRequest,
    folder: Path,
    options: OneMeshOptions,
    instances: bool,
) -> None:
    """Write a stage with one mesh of each subject, or with the instances of each."""
    from flowsculpt.pipeline.plugins.interchange.copy_instances import require_rigid
    from flowsculpt.pipeline.plugins.interchange.usd_instances import InstancesStage
    from flowsculpt.pipeline.plugins.interchange.usd_one_mesh import OneMeshStage

    parts = options.unifications(asked, project)
    if instances:
        require_rigid(parts)
    kind = InstancesStage if instances else OneMeshStage
    if common.dry_run:
        report_plan(common, project.geometry(asked))
        return
    started = time.monotonic()
    outcome = execute(common, lambda: project.geometry(asked))
    with Locks(common.root).hold_with_writers(common.wait), progress_bars(common.progress) as bar:
        stage = kind(asked, project.store, folder, parts, bar)
        stage.write(bar("exporting", len(stage.stale())))
    print_result(*_report(stage, [], time.monotonic() - started), common.json)
    raise typer.Exit(outcome.exit_code)


def ply(common: Common, shot: Shot, options: ModelOptions) -> None:
    """Write a PLY file of each frame's mesh, simulating what is missing.

    `flowsculpt export ply A010_cube -f 1-24` writes renders/A010_cube/models/A010_cube.0001.ply and so on. Of
    several subjects each has a file; `--subject heron` chooses one.
    """
    _models(common, shot, options, "ply")


def obj(common: Common, shot: Shot, options: ModelOptions) -> None:
    """Write an OBJ file of each frame's mesh, simulating what is missing.

    `flowsculpt export obj A010_cube -f 1-24` writes renders/A010_cube/models/A010_cube.0001.obj and so on. Of
    several subjects each has a file; `--subject heron` chooses one.
    """
    _models(common, shot, options, "obj")


def glb(common: Common, shot: Shot, options: ModelOptions) -> None:
    """Write a glTF file of one frame's mesh, for pages and viewers.

    `flowsculpt export glb A010_cube -f 40` writes renders/A010_cube/models/A010_cube.0040.glb.
    """
    _models(common, shot, options, "glb")


def stl(
    common: Common,
    shot: Shot,
    options: ModelOptions,
    size: Annotated[
        float, typer.Option(min=1.0, max=10_000.0, metavar="MM", help="The longest side, millimetres.")
    ] = LONGEST_SIDE,
) -> None:
    """Write an STL file of one frame's mesh for 3-D printing; report its volume and thinnest wall.

    `flowsculpt export stl A010_cube -f 40 --size 120` writes a model 120 mm long.
    """
    _models(common, shot, options, "stl", size)


def _models(common: Common, shot: str, options: ModelOptions, form: str, size: float = LONGEST_SIDE) -> None:
    """Write mesh files of the subjects of a shot."""
    project, asked, folder = asked_for(common, shot, options, DEFAULT_QUALITY, "models")
    require_still(form, options.frames, len(asked.requested))
    exports = [ModelExport(part, project.store, folder, form, size) for part in asked.parts]
    _export(common, project, asked, exports)


def asked_for(
    common: Common, shot: str, options: ModelOptions, quality: str, name: str
) -> tuple[Project, RenderRequest, Path]:
    """Return the project, the frames to export, and their folder, which has a name by default."""
    project = options.project(common)
    asked = project.find_request(shot, quality, options.frames, FrameStates.of_meshes, variant="none")
    asked = asked.of_subject(options.subject)
    folder = options.output.absolute() if options.output else common.root / asked.folders.home / name
    return project, asked, folder


def _export(
    common: Common, project: Project, asked: RenderRequest, exports: Sequence[UsdExport | ModelExport]
) -> None:
    """Simulate what is missing, write the files that are not current, and report them."""
    plan_of = project.mesh_frames if isinstance(exports[0], ModelExport) else project.geometry
    if common.dry_run:
        report_plan(common, plan_of(asked))
        if not common.json:
            for export in exports:
                frames = plural(len(export.stale()), "frame")
                print_result(f"Then: writing {frames} to {export.folder}.", {}, False)
        return
    started = time.monotonic()
    outcome = execute(common, lambda: plan_of(asked))
    faults: list[str] = []
    with Locks(common.root).hold_with_writers(common.wait), progress_bars(common.progress) as bar:
        for export in exports:
            faults += export.write(bar("exporting", len(export.stale())))
    for fault in faults:
        print_error(fault)
    seconds = time.monotonic() - started
    reports = [_report(export, faults, seconds) for export in exports]
    words = "\n".join(words for words, _ in reports)
    facts: Any = reports[0][1] if len(reports) == 1 else [facts for _, facts in reports]
    print_result(words, facts, common.json)
    raise typer.Exit(outcome.exit_code or (FrameError.exit_code if faults else 0))


def _report(
    export: UsdExport | ModelExport, faults: Sequence[str], seconds: float
) -> tuple[str, dict[str, Any]]:
    """Return what an export has written, in words and as data."""
    written, shown = export.files.written, export.shown()
    words = f"{export.path}: {plural(len(shown), 'frame')}, {plural(len(written), 'file')} written"
    words += f" in {seconds:.0f} s."
    facts: dict[str, Any] = {"path": str(export.path), "frames": shown, "written": list(written)}
    if isinstance(export, ModelExport) and not faults and (report := export.print_report()):
        facts["model"] = report.as_data()
        words += f"\n{report.in_words()}"
    return words, facts | {"failed": list(faults), "seconds": round(seconds, 2)}
