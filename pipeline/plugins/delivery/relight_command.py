"""The command `relight`: mix light groups of finished frames again, by factors as `lights.key=1.4`."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
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
from pipeline.errors import FrameError, MissingInputError, UsageError, shortened, suggestion
from pipeline.plugins.delivery.relit_frames import RelitFrames
from pipeline.production.request.lookup import find_shot, options_of
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store.locks import writing
from pipeline.shot.documents.field_types import HEX_PATTERN, linear_of
from pipeline.shot.yaml.inheritance import OPTION, inherited
from pipeline.shot.yaml.named_files import NAME, shown
from pipeline.shot.yaml.yaml_source import in_yaml
from render.base.plural import plural
from render.base.serialise import Triple
from render.scene.render_quality import DEFAULT_QUALITY
from render.scene.scene_lights import BACKGROUND, LightGroup, LightRig

MAX_FACTOR = 1e6

MOST_LETTERS = 60  # letters of the longest name that factors give to a version

_FACTOR = re.compile(r"\s*lights\.(\w+)\s*=(.*)", re.DOTALL)
_INTENSITY = re.compile(r"\s*lights\.intensity(?:\.(\w+))?\s*=(.*)", re.DOTALL)

_OF_SHOT = ("exposure", "hdri", "rig", "softboxes", "turn", "visible")
"""Names under `lights` in a shot file that are not lights."""


@dataclass(frozen=True)
class LightSettings:
    """Settings of the command line: factors on light groups as typed, and settings of the shot."""

    factors: Mapping[str, str]
    of_shot: tuple[str, ...]

    @classmethod
    def of(cls, settings: Iterable[str]) -> LightSettings:
        """Split settings; of several factors on one group the last counts. Raises UsageError."""
        factors, others = {}, []
        for setting in settings:
            if match := _INTENSITY.fullmatch(setting):
                raise UsageError(
                    f"{OPTION} {setting}: an intensity belongs to the shot; changing it renders frames "
                    "again. Scale "
                    f"the rendered light by a factor instead: lights.{match[1] or 'key'}={match[2]}"
                )
            match = _FACTOR.fullmatch(setting)
            if match and match[1] not in _OF_SHOT:
                factors[match[1]] = match[2].strip()
            else:
                others.append(setting)
        return cls(factors, tuple(others))

    def by_group(self, shot: str, groups: Sequence[LightGroup]) -> dict[str, Triple]:
        """Return the factors (red, green, blue) by light group, in the order of the groups.

        Raises UsageError where there are none, for a group that the shot does not have, and for text that is
        no factor.
        """
        names = [group.name for group in groups]
        if not self.factors:
            raise UsageError(
                f"no light is set. Write, for example, {OPTION} lights.{names[0]}=1.4; the light groups of "
                f"{shot} are {', '.join(names)}"
            )
        for name in self.factors:
            if name not in names:
                owner = next((group.name for group in groups if name in group.lights), None)
                remedy = f"It is in group {owner}: set lights.{owner}." if owner else suggestion(name, names)
                raise UsageError(f"{OPTION} lights.{name}: {shot} has no light group {name}. {remedy}")
        return {name: _parsed(name, self.factors[name]) for name in names if name in self.factors}


def _parsed(name: str, text: str) -> Triple:
    """Return a factor: one number, three of linear Rec.709, or a hexadecimal colour of sRGB."""
    bare = text.strip("[]()'\" ")
    if re.fullmatch(HEX_PATTERN, bare):
        red, green, blue = linear_of(bare)
        return red, green, blue
    try:
        numbers = [float(part) for part in bare.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (1, 3) or not all(math.isfinite(n) and 0.0 <= n <= MAX_FACTOR for n in numbers):
        raise UsageError(
            f"{OPTION} lights.{name}: {shortened(text)} is not a factor from 0 to 1e6. Write a number, "
            f"lights.{name}=1.4, or a colour, lights.{name}=1,0.8,0.6 or 'lights.{name}=#ffd0a0'"
        )
    red, green, blue = numbers * (3 // len(numbers))
    return red, green, blue


def version_name(factors: Mapping[str, Triple]) -> str:
    """Return a name for frames with these factors, as in `key1.4_rim1-0.8-0.6`."""
    words = [
        name + "-".join(f"{value:.4g}" for value in (factor[:1] if _is_grey(factor) else factor))
        for name, factor in factors.items()
    ]
    return "_".join(words).replace("+", "")[:MOST_LETTERS]


def permanent(path: Path, of_shot: Sequence[str], lights: LightRig, factors: Mapping[str, Triple]) -> str:
    """Return how the factors are written in the shot file at `path`; `of_shot` are settings over it."""
    members = {each.name: [name for name in each.lights if name != BACKGROUND] for each in lights.groups}
    refused = [
        name
        for name, factor in factors.items()
        if not _is_grey(factor) and set(members[name]) & set(lights.keeping_colours)
    ]
    written_factors = {name: factor for name, factor in factors.items() if name not in refused}
    words = []
    if any(members[name] for name in written_factors):
        data: Any = inherited(path, None, tuple(of_shot), None).data
        written = data.get("lights")
        before = written.get("intensity", 1.0) if isinstance(written, dict) else 1.0
        if not isinstance(before, dict):
            before = {} if before == 1.0 else dict.fromkeys(lights.names, float(before))
        after = {
            light: _multiplied(before.get(light, 1.0), factor)
            for name, factor in written_factors.items()
            for light in members[name]
        }
        intensity = {**before, **after}
        if isinstance(written, dict):
            words.append(f"write intensity: {in_yaml(intensity)} under lights in {shown(path)}")
        else:
            rig = {"rig": written or "studio", "intensity": intensity}
            words.append(f"write lights: {in_yaml(rig)} in {shown(path)}")
    if refused:
        words.append(
            f"{', '.join(refused)}: the colour of daylight and of an hdri cannot be set; write softboxes or "
            "a sky with a radiance of that colour"
        )
    sentences = ["To render with these lights, " + "; ".join(words) + "."] if words else []
    if len({_factor_on(light, lights, factors) for light in ("sky", BACKGROUND)} - {None}) > 1:
        sentences.append("Only relit frames can show a sky brighter or darker than its light.")
    return " ".join(sentences)


def _multiplied(intensity: Any, factor: Triple) -> float | list[float]:
    """Return the intensity of a shot file, a number or a colour, times a factor."""
    before = linear_of(intensity) if isinstance(intensity, str) else intensity
    parts = before if isinstance(before, Sequence) else [before] * 3
    product = [float(f"{float(a) * b:.6g}") for a, b in zip(parts, factor, strict=True)]
    return product[0] if len(set(product)) == 1 else product


def _factor_on(light: str, lights: LightRig, factors: Mapping[str, Triple]) -> Triple | None:
    """Return the factor on a light, or None where it is in no group."""
    owner = next((group.name for group in lights.groups if light in group.lights), None)
    return None if owner is None else factors.get(owner, (1.0, 1.0, 1.0))


def _is_grey(factor: Triple) -> bool:
    return len(set(factor)) == 1


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
    if name is not None and not re.fullmatch(NAME, name):
        raise UsageError(f"--name {name}: a version has letters, digits, _, - and . in its name, as warm_key")
    version = name or version_name(factors)
    relit = RelitFrames(project.as_finished(request), project.store, factors, version)
    if missing := relit.missing():
        raise MissingInputError(
            f"{request.name}: frame {missing} is not finished at {request.quality_name}, so it cannot be "
            f"relit. Render it first: {_command('render', relit.request)} -f {missing}"
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


def _command(command: str, request: RenderRequest) -> str:
    """Return a command line for the shot and quality of a request."""
    settings = "".join(f" --set '{setting}'" for setting in request.source.settings)
    return f"flowsculpt {command} {request.name} {options_of(request.quality_name)}{settings}"
