"""The commands `render`, `film`, `stills` and `simulate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flowsculpt.pipeline.cli.execution import execute_and_report
from flowsculpt.pipeline.cli.options import (
    Common,
    Force,
    Frames,
    Layers,
    NoPreview,
    PictureOptions,
    Quality,
    ShotOptions,
    Shots,
    Variant,
)
from flowsculpt.pipeline.cli.output import duration_words, err
from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.plugin import named, plugins
from flowsculpt.pipeline.production.planning.estimate import Forecast, estimate, typical_seconds
from flowsculpt.pipeline.production.planning.plan import Plan
from flowsculpt.pipeline.production.request.lookup import Show
from flowsculpt.pipeline.production.request.render_request import FORMS
from flowsculpt.pipeline.production.store.store import Store
from flowsculpt.render.base.atomic_write import write_text
from flowsculpt.render.base.plural import plural
from flowsculpt.render.scene.render_quality import DEFAULT_QUALITY


def render(
    common: Common,
    shots: Shots,
    options: PictureOptions,
    frames: Frames = None,
    quality: Quality = DEFAULT_QUALITY,
    layers: Layers = None,
    force: Force = False,
    no_preview: NoPreview = False,
) -> None:
    """Render shots, or some of their frames, and assemble their movies.

    `flowsculpt render A010_cube -f 10-20x2` renders six frames to renders/A010_cube/draft; the
    second time it renders none, for only what is missing or stale is made. Crops and scaled pictures have
    folders of their own, such as draft.scale50. A crop shows what the whole picture shows there, with other
    noise.

    `flowsculpt render A010_cube -q final --layers nuke` writes frames with the layers that a compositor
    needs: depth, motion vectors, normals, positions, cryptomatte. Frames of daily and final that are rendered
    already are reused, except in shots with copies.

    Keys decide what is stale, and stored results are trusted. After a change that no key knows, such as of a
    graphics driver, `flowsculpt render A010_cube --force` renders again and replaces what is stored.
    """
    project = options.project(common).with_layers(layers)
    project = project.force_from("render") if force else project
    quality = options.quality(quality, project, shots)
    execute_and_report(common, lambda: project.pictures(shots, quality, frames), preview=not no_preview)


def film(
    common: Common,
    options: ShotOptions,
    edit: Annotated[
        str, typer.Argument(metavar="EDIT", help="An edit: its name in shots/, or the path of its file.")
    ] = Show().film.stem,
    quality: Quality = DEFAULT_QUALITY,
    variant: Variant = None,
    layers: Layers = None,
    force: Force = False,
    timeline: Annotated[
        Path | None,
        typer.Option("--edit", metavar="FILE", help="A timeline (.otio) to cut the film by; see below."),
    ] = None,
    no_preview: NoPreview = False,
) -> None:
    """Render every shot of an edit and cut them into a film.

    `flowsculpt film` renders shots/film.yaml to renders/film/draft/film.mp4; `flowsculpt film showreel -q
    final` renders shots/showreel.yaml to renders/film/final/showreel.mp4. `--set` holds for every shot.

    `flowsculpt film --edit cut.otio` takes the cut of an editing program: it writes shots/cut.yaml, with the
    clips, dissolves, cards and sound of the OpenTimelineIO file, and renders that. Clips are shots by their
    own names or by those of their media.
    """
    project = options.project(common, variant).with_layers(layers)
    if timeline is not None:
        edit = _written_edit(common, timeline)
    project = project.force_from("render") if force else project
    execute_and_report(common, lambda: project.film(quality, Show().find_edit(edit)), preview=not no_preview)


def _written_edit(common: Common, timeline: Path) -> str:
    """Write the edit of a timeline to the folder of shots; return its path."""
    readers = plugins().readers("edit")
    if (reader := readers.get(timeline.suffix.lstrip("."))) is None:
        known = ", ".join(f".{suffix}" for suffix in readers)
        rule = f"the names of timelines end in {known}; export one as that"
        raise UsageError(f"--edit {timeline}: {plugins().lacking(timeline.suffix) or rule}")
    target, text = named(reader)(timeline, Show().shots(), Show().folder)
    if common.dry_run and not target.exists():
        raise UsageError(f"--dry-run: {target} is not written yet; call film --edit once without it")
    if not common.dry_run:
        write_text(target, text)
    return str(target)


def simulate(common: Common, shots: Shots, options: ShotOptions, frames: Frames = None) -> None:
    """Simulate shots: move and resample their surfaces, frame by frame.

    `flowsculpt simulate A010_cube -f 1-24` writes 24 mesh frames to renders/A010_cube/meshes. After an edit
    of the shot, the simulation resumes at the last frame that is still valid.

    Vertices keep their numbers through the whole shot, and new vertices name their parents, with method
    triangles.
    """
    project = options.project(common)
    execute_and_report(common, lambda: project.meshes(shots, frames))


LARGE = 1920 * 1080
"""For pictures of at least so many pixels, the command says what rendering will take."""


def stills(
    common: Common,
    shots: Shots,
    options: PictureOptions,
    frames: Frames = None,
    quality: Quality = DEFAULT_QUALITY,
    form: Annotated[
        str,
        typer.Option(
            "--as", metavar="FORM", help=f"One of {', '.join(FORMS)}: 8 bits, 16 bits, or 8 bits compressed."
        ),
    ] = "png",
) -> None:
    """Write frames of shots as PNG or JPEG, rendering what is missing.

    `flowsculpt stills A010_cube -f 40` writes one frame to renders/A010_cube/draft/png; with `-q final` it
    has 1920 × 1080 pixels. The command says what rendering so large a frame takes before it begins.

    Stills have the shot's exposure and view transform; JPEG of a spherical shot opens as a panorama. Frames
    in linear EXR, with all AOVs, lie in renders/SHOT/QUALITY/frames and raw.
    """
    project = options.project(common)
    quality = options.quality(quality, project, shots)
    announced: set[str] = set()

    def planned() -> Plan:
        plan = project.stills(shots, form, quality, frames)
        words = "" if common.dry_run else _cost(common, plan)
        if words and words not in announced:
            announced.add(words)
            err.print(words)
        return plan

    execute_and_report(common, planned)


def _cost(common: Common, plan: Plan) -> str:
    """Return what rendering the large frames of a plan takes, in words; empty if it renders none."""
    large = plan.requests[0].pictures.quality
    width, height = large.rendered_size
    if not plan.frame_counts()["render"] or width * height < LARGE:
        return ""
    forecast = Forecast.of(plan, Store(common.root))
    count = forecast.plan.frame_counts()["render"]
    if not count:
        return ""
    expected = estimate(forecast.plan, common.root, common.cores)
    seconds, by = expected.seconds, expected.by
    if not by:
        seconds, by = (
            count * typical_seconds("render", large) / common.cores,
            "a typical shot; none was rendered here yet",
        )
    samples = f"{'at most ' if large.is_adaptive else ''}{plural(large.samples, 'sample')}"
    frames = f"{plural(count, 'frame')} of {width} × {height} pixels, {samples} each"
    about = "at most" if forecast.unframed else "about"
    time = f"{about} {duration_words(seconds)} on {plural(common.cores, 'core')}, by {by}"
    return f"To be rendered: {frames}. That takes {time}."
