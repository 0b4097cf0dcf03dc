"""The command `export`: files that other programs read."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from pipeline.cli.execution import execute, report_notes, report_plan
from pipeline.cli.farm_files import FOR_FARMS, FarmFiles
from pipeline.cli.options import (
    Common,
    Frames,
    PictureOptions,
    Quality,
    Subject,
    output_option,
    require_one_of,
)
from pipeline.cli.output import exit_with, print_error, print_result, progress_bars
from pipeline.dailies.delivery.timeline import MEDIA, Timeline
from pipeline.dailies.interchange.model_export import MODELS, ModelExport, require_still
from pipeline.dailies.interchange.print_model import LONGEST_SIDE
from pipeline.dailies.interchange.usd_export import UsdExport
from pipeline.errors import FrameError, UsageError
from pipeline.mesh.usd_files import require_usd
from pipeline.production.execution.project import Project
from pipeline.production.planning.frame_states import mesh_states
from pipeline.production.request.lookup import FILM, find_edit
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store.locks import writing
from render.base.plural import plural
from render.scene.quality import DEFAULT_QUALITY

FORMATS = ("usd", *MODELS, *FOR_FARMS, "otio")


def export(
    common: Common,
    form: Annotated[
        str,
        typer.Argument(
            metavar="FORMAT",
            help="usd: the sculpture with its motion, camera and lights; ply, obj: a mesh file for each "
            "frame; glb, stl: a mesh file of one frame; openjd: Open Job Description, plan: what tasks read, "
            "both for render managers; kubernetes: manifests of Jobs; otio: OpenTimelineIO, for editors.",
        ),
    ],
    options: PictureOptions,
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="SHOT|EDIT",
            help="A shot, by name or path; openjd, kubernetes, plan: several, or an edit. otio: an edit, by "
            "default the film. It may stand before the format.",
        ),
    ] = None,
    output: Annotated[
        Path | None,
        output_option(
            "openjd, plan, otio: a file. Else a folder; default: kubernetes, renders/SHOT/usd or models.",
            "PATH",
        ),
    ] = None,
    media: Annotated[
        str, typer.Option(metavar="NAME", help=f"Media that otio clips refer to: {', '.join(MEDIA)}.")
    ] = "frames",
    size: Annotated[
        float, typer.Option(min=1.0, max=10_000.0, metavar="MM", help="stl: the longest side, millimetres.")
    ] = LONGEST_SIDE,
    image: Annotated[
        str | None, typer.Option(metavar="NAME", help="kubernetes: the container image of the pods.")
    ] = None,
    frames: Frames = None,
    subject: Subject = None,
    quality: Quality = DEFAULT_QUALITY,
) -> None:
    """Write a shot for other 3-D programs, a render manager's job, or an editing program's timeline.

    `flowsculpt export usd A010_cube` writes renders/A010_cube/usd/A010_cube.usda, which Houdini, Blender and
    usdview open, and beside it a clip for each frame: the mesh with velocities, normals and rest positions.
    What is missing is simulated first. The second time only clips that changed are written. It needs the
    package usd-core; see docs/interchange.md.

    `flowsculpt export ply A010_cube -f 1-24` writes renders/A010_cube/models/A010_cube.0001.ply and so on,
    `flowsculpt export stl A010_cube -f 40 --size 120` a model to be printed, 120 mm long, and reports its
    volume and its thinnest wall. Of several subjects each has a file; `--subject heron` chooses one.

    `flowsculpt export openjd A010_cube` writes a job template that renders the shot and assembles its movie,
    and beside it the plan that its tasks read, template.yaml.plan.json: the shot as it is now. `flowsculpt
    export openjd A010_cube A020_lorenz` writes one job of two shots, `flowsculpt export openjd film` one of
    all shots of an edit and its film. `openjd run template.yaml` executes it here; a render manager executes
    it on workers, which see the root under the same path or under the parameter Root, or share a remote
    store. Tasks skip what is already rendered.

    `flowsculpt export plan A010_cube -o plan.json` writes the plan alone, whose parts `flowsculpt task` does
    on the workers of any render manager.

    `flowsculpt export kubernetes A010_cube --image registry/flowsculpt:1 --store s3://bucket/show` writes
    kubernetes/: a ConfigMap with the plan, indexed Jobs whose pods do its tasks, and run.sh, which creates
    them with kubectl one level after the other.

    `flowsculpt export otio showreel -q final` writes showreel.otio: clips, dissolves, cards and sound of
    shots/showreel.yaml. Clips refer to frames, relative to the file, or to files that `flowsculpt deliver`
    wrote: `--media prores4444`.
    """
    names = names or []
    if form not in FORMATS and len(names) == 1 and names[0] in FORMATS:
        form, names = names[0], [form]
    require_one_of(form, FORMATS, f"{form!r} is not a format to export.")
    project = options.project(common)
    quality = options.quality(quality, project, names)
    if len(names) > 1 and form not in FOR_FARMS:
        raise UsageError(f"export {form} takes one {'edit' if form == 'otio' else 'shot'}, not {len(names)}")
    if form in FOR_FARMS:
        files = FarmFiles.named(form, output, image)
        plan = project.whole(_require_names(names, form), quality, frames)
        report_notes(plan, set())
        files.write(common, plan, "+".join(names))
    elif form == "otio":
        _timeline(common, project, quality, names[0] if names else FILM.stem, output, media, frames)
    else:
        (shot,) = _require_names(names, form)
        asked = project.asked(shot, quality, frames, mesh_states, variant="none").of_subject(subject)
        require_still(form, frames, len(asked.requested))
        exports = [_export_of(common, project, part, form, output, size) for part in _parts(asked, form)]
        _geometry(common, project, asked, exports)


def _parts(asked: RenderRequest, form: str) -> Sequence[RenderRequest]:
    """Return the requests that are exported one by one: a stage holds all subjects, mesh files one each.

    Raises UsageError for a stage of one of several subjects.
    """
    if form != "usd":
        return asked.parts
    if asked.source.subject:
        raise UsageError(
            f"--subject {asked.source.subject}: a USD stage holds all subjects of {asked.name}, each as a "
            "prim. Leave --subject out"
        )
    return [asked]


def _geometry(
    common: Common, project: Project, asked: RenderRequest, exports: Sequence[UsdExport | ModelExport]
) -> None:
    """Simulate what is missing, write the files that are not current, and report them."""
    plan_of = project.geometry if isinstance(exports[0], UsdExport) else project.mesh_frames
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
    with writing(common.root, common.wait), progress_bars(common.progress) as bar:
        for export in exports:
            faults += export.write(bar("exporting", len(export.stale())))
    for fault in faults:
        print_error(fault)
    seconds = time.monotonic() - started
    told = [_told(export, faults, seconds) for export in exports]
    words = "\n".join(words for words, _ in told)
    facts: Any = told[0][1] if len(told) == 1 else [facts for _, facts in told]
    print_result(words, facts, common.json)
    exit_with(outcome.exit_code or (FrameError.exit_code if faults else 0))


def _told(
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


def _export_of(
    common: Common, project: Project, asked: RenderRequest, form: str, output: Path | None, size: float
) -> UsdExport | ModelExport:
    """Return the export of a request to a folder."""
    home = common.root / asked.folders.home
    if form == "usd":
        require_usd()
        return UsdExport(asked, project.store, output.absolute() if output else home / "usd")
    return ModelExport(asked, project.store, output.absolute() if output else home / "models", form, size)


def _require_names(names: list[str], form: str) -> list[str]:
    """Return the names of shots. Raises UsageError where none is given."""
    if not names:
        raise UsageError(f"export {form} needs the name of a shot; flowsculpt status lists shots")
    return names


def _timeline(
    common: Common,
    project: Project,
    quality: str,
    edit: str,
    output: Path | None,
    media: str,
    frames: str | None,
) -> None:
    require_one_of(media, MEDIA, f"--media {media}: clips cannot refer to it.")
    if frames is not None:
        raise UsageError(f"-f {frames} chooses frames of shots; an edit names its own")
    path = find_edit(edit)
    place = output or Path(f"{path.stem}.otio")
    if place.suffix != ".otio":
        raise UsageError(f"{place}: a timeline's name ends in .otio; call it {place.stem}.otio")
    cut, requests = project.edit(quality, path)
    if not common.dry_run:
        Timeline(cut, requests, common.root, media, place).write()
    done = f"{place}: {plural(cut.length, 'frame')}, {common.done('written')}."
    print_result(done, {"timeline": str(place), "frames": cut.length, "media": media}, common.json)
