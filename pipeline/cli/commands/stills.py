"""The command `stills`: frames as PNG or JPEG."""

from __future__ import annotations

from typing import Annotated

import typer

from pipeline.cli.execution import execute_and_report
from pipeline.cli.options import Common, Frames, PictureOptions, Quality, Shots
from pipeline.cli.output import duration, err
from pipeline.production.planning.estimate import estimate, typical_seconds
from pipeline.production.planning.forecast import Forecast
from pipeline.production.planning.plan import Plan
from pipeline.production.request.render_request import FORMS
from pipeline.production.store.store import Store
from render.base.plural import plural
from render.scene.quality import DEFAULT_QUALITY

LARGE = 1920 * 1080
"""Pixels of a picture from which on the command says what rendering will take."""


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

    Stills have the shot's exposure and view transform. Frames in linear EXR, with all AOVs, lie in
    renders/SHOT/QUALITY/frames and raw.
    """
    project, quality = options.project(common), options.quality(quality)
    announced: set[str] = set()

    def planned() -> Plan:
        plan = project.stills(shots, form, quality, frames)
        words = "" if common.dry_run else _cost(common, plan)
        if words and words not in announced:
            announced.add(words)
            err.print(words, markup=False)
        return plan

    execute_and_report(common, planned)


def _cost(common: Common, plan: Plan) -> str:
    """Return what rendering the large frames of a plan takes, in words; empty if it renders none."""
    large = plan.requests[0].quality
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
            count * typical_seconds(large) / common.cores,
            "a typical shot; none was rendered here yet",
        )
    frames = f"{plural(count, 'frame')} of {width} × {height} pixels, {plural(large.samples, 'sample')} each"
    about = "at most" if forecast.unframed else "about"
    time = f"{about} {duration(seconds)} on {plural(common.cores, 'core')}, by {by}"
    return f"To be rendered: {frames}. That takes {time}."
