"""The command `relight`: mix the light groups of finished frames again."""

from __future__ import annotations

import re
import time
from typing import Annotated, Any

import typer

from pipeline.cli.options import (
    AllowCode,
    Common,
    Crop,
    Frames,
    PictureOptions,
    Quality,
    Scale,
    Shot,
    Variant,
    project_of,
)
from pipeline.cli.output import exit_with, print_error, print_result, progress_bars
from pipeline.errors import FrameError, MissingInputError, UsageError
from pipeline.plugins.delivery.light_factors import LightSettings, permanent, version_name
from pipeline.plugins.delivery.relit_frames import RelitFrames
from pipeline.production.request.lookup import find_shot, options_of
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store.locks import writing
from pipeline.shot.yaml.named_files import NAME, shown
from render.base.plural import plural
from render.scene.render_quality import DEFAULT_QUALITY


def relight(
    common: Common,
    shot: Shot,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="lights.NAME=FACTOR",
            help="Multiply the light of a group: by a number, as in lights.key=1.4, or by a colour, as in "
            "lights.rim=1,0.8,0.6 or 'lights.rim=#ffd0a0'; 0 turns it off. Repeatable. Other names replace "
            "values of the shot, as in `render`.",
        ),
    ] = None,
    quality: Quality = DEFAULT_QUALITY,
    frames: Frames = None,
    name: Annotated[
        str | None, typer.Option(metavar="VERSION", help="The folder of the frames. Default: the factors.")
    ] = None,
    crop: Crop = None,
    scale: Scale = None,
    variant: Variant = None,
    allow_code: AllowCode = False,
) -> None:
    """Change lights of finished frames by factors, without rendering: new frames and a movie in seconds.

    The shot needs light groups: write `light_groups: each` in its file and render it once. Then
    `flowsculpt relight A010_cube -q daily --set lights.key=1.4 --set lights.rim=1,0.8,0.6` writes frames and
    a movie to renders/A010_cube/daily/relight/key1.4_rim1-0.8-0.6: the same light as a render, through
    the same view. At the end it prints what to write in the shot file to render with these lights.
    """
    given = LightSettings.of(settings or ())
    project = project_of(common, given.of_shot, allow_code, variant)
    quality_name = PictureOptions(crop, scale).quality(quality, project, [shot])
    request = project.asked(shot, quality_name, frames)
    lights, path = request.shot.picture.lights, find_shot(shot)
    if not lights.groups:
        raise UsageError(
            f"{shown(path)}: {request.name} has no light groups, so its frames cannot be relit. Write "
            f"light_groups: each in the file, and render it: {_command('render', request)}"
        )
    factors = given.by_group(request.name, lights.groups)
    version = _version(name) or version_name(factors)
    relit = RelitFrames(project.as_finished(request), project.store, factors, version)
    if missing := relit.missing():
        raise MissingInputError(
            f"{request.name}: frame {missing} is not finished at {request.quality_name}, so it cannot be "
            "relit. "
            f"Render it first: {_command('render', relit.request)} -f {missing}"
        )
    count = plural(len(relit.numbers), "frame")
    facts: dict[str, Any] = {"path": str(relit.movie_path), "frames": relit.numbers, "factors": factors}
    if common.dry_run:
        print_result(f"{relit.movie_path}: {count} would be relit.", facts, common.json)
        return
    started = time.monotonic()
    with writing(common.root, common.wait), progress_bars(common.progress) as bar:
        made, faults = relit.make(common.cores, bar)
    seconds = time.monotonic() - started
    for fault in faults:
        print_error(fault)
    if faults:
        words = f"{plural(len(faults), 'frame')} could not be relit, so no movie was made."
    else:
        facts["permanent"] = permanent(path, given.of_shot, lights, factors)
        words = f"{relit.movie_path}: {count}, {made} relit in {seconds:.0f} s.\n{facts['permanent']}"
    facts |= {"relit": made, "failed": faults, "seconds": round(seconds, 2)}
    print_result(words, facts, common.json)
    exit_with(FrameError.exit_code if faults else 0)


def _version(name: str | None) -> str | None:
    """Return a name that a folder can have, or None. Raises UsageError."""
    if name is not None and not re.fullmatch(NAME, name):
        raise UsageError(
            f"--name {name}: the name of a version consists of letters, digits, _, - and ., as in warm_key"
        )
    return name


def _command(command: str, request: RenderRequest) -> str:
    """Return a command line for the shot and quality of a request."""
    settings = "".join(f" --set '{setting}'" for setting in request.source.settings)
    return f"flowsculpt {command} {request.name} {options_of(request.quality_name)}{settings}"
