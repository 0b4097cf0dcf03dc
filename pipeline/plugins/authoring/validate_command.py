"""The command `validate`: check shot files."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Annotated, Any

import typer
from rich.console import Group
from rich.table import Table

from flowsculpt import FlowsculptError, FrameError, UsageError
from flowsculpt.api import Progress, ShotError
from flowsculpt.api.commands import (
    Project,
    empty_table,
    print_error,
    print_result,
    print_warning,
    progress_bars,
    size_words,
)
from flowsculpt.api.frames import FinishedPictures, QualityName, Show
from flowsculpt.api.options import Common, shared_option
from flowsculpt.api.shots import Clock, Motion, Shot, WrittenShot, YamlSource, read_shot
from flowsculpt.pipeline.plugins.authoring.first_frame import FirstFrame, FirstFrames
from flowsculpt.pipeline.plugins.authoring.scene_rules import Finding, findings, loop_report


def validate(
    common: Common,
    shots: Annotated[
        list[str] | None, typer.Argument(metavar="SHOT", help="Shots and edits. Default: all.")
    ] = None,
    settings: Annotated[list[str] | None, shared_option("settings")] = None,
) -> None:
    """Check shot files and the scenes they describe; report every mistake by file, line and column.

    `flowsculpt validate` checks all shots and edits in shots/; `flowsculpt validate A010_cube --set
    resample.max_edge_length=0.1` checks one shot with another value.

    Models are loaded, and the first frame is computed: repairs, vertices and memory are listed.
    Warnings flag shots that render but probably look wrong: edges that are coarse for the subject, a camera
    inside of it, flows that act elsewhere or take minutes a frame. Of finished frames, the light is looked
    at too.
    """
    edits, given = Show().edits(), tuple(settings or ())
    for warning in () if shots else Show().misnamed().values():
        print_warning(warning)
    names = shots or [*Show().shots(), *edits]
    if not names:
        raise UsageError("no shots here: shots/ is empty. `flowsculpt new A010_first` writes one")
    first_frames, checks = FirstFrames(), []
    with progress_bars(common.progress) as bar:
        advance = bar("checking", len(names))
        for name in names:
            with Progress.reported_to(_Bars(bar).receive):
                check = _check_edit(name, given) if name in edits else _check(name, given, first_frames)
            if name not in edits and not check.errors:
                check.warnings += [f"{name}: {note}" for note in _light(common, name, given)]
            checks.append(check)
            advance()
    _report(common, checks)
    raise typer.Exit(max(check.exit_code for check in checks))


LOOKED_AT = 8
"""Frames that the light of a shot is judged by."""


class _Bars:
    """Bars of the long computations of flows, such as fits."""

    def __init__(self, bar: Callable[[str, int], Callable[[], None]]) -> None:
        self._bar = bar
        self._bars: dict[str, tuple[Callable[[], None], int]] = {}

    def receive(self, progress: Progress) -> None:
        """Draw what is counted up to few: points that a flow moves are not."""
        activity, done, total, _ = progress
        if 0 < total < 1000:
            advance, before = self._bars.get(activity) or (self._bar(activity, total), 0)
            for _ in range(done - before):
                advance()
            self._bars[activity] = advance, done


@dataclass
class _Check:
    """The result for one file. Errors and warnings begin with file, line and column.

    firsts  the first frame of each of several subjects by name, or of the one under an empty name
    """

    name: str
    errors: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    firsts: dict[str, FirstFrame] = field(default_factory=dict)
    exit_code: int = 0

    def add_error(self, error: FlowsculptError) -> None:
        self.errors += str(error).splitlines()
        self.exit_code = max(self.exit_code, error.exit_code)

    def as_data(self) -> dict[str, Any]:
        facts = {"file": self.name, "errors": self.errors, "warnings": self.warnings, "notes": self.notes}
        frames = {name: first.as_data() for name, first in self.firsts.items()}
        if "" in frames:
            return {**facts, "first_frame": frames[""]}
        return {**facts, "first_frames": frames} if frames else facts


def _check_edit(name: str, settings: tuple[str, ...]) -> _Check:
    """Check an edit and the files of its shots."""
    check = _Check(name)
    try:
        Show().check_edit(name, settings)
    except FlowsculptError as error:
        check.add_error(error)
    return check


def _check(name: str, settings: tuple[str, ...], first_frames: FirstFrames) -> _Check:
    """Check a shot file, and if it is well written its scene."""
    check = _Check(name)
    try:
        path = Show().find_shot(name)
        shot, written = read_shot(path, settings=settings), WrittenShot.read(path, settings=settings)
    except FlowsculptError as error:
        check.add_error(error)
        return check
    outside = written.outside_note(shot.motion.clock)
    if outside:
        check.warnings.append(" ".join([outside, *_of_outer_keys(written.source, shot.motion.clock)]))
    check.notes += [f"{name}: {line}" for line in shot.notes if line != outside]
    for part in shot.parts:
        _check_scene(check, part, first_frames, written)
    check.notes = list(dict.fromkeys(check.notes))
    return check


def _of_outer_keys(source: YamlSource, clock: Clock) -> Iterator[str]:
    """Yield what keys outside of the shot mean for it: still curves, and motion that is left out."""
    still, is_early = list[str](), False
    for where, mapping in source.mappings():
        if not isinstance(keys := mapping.get("keys"), dict):
            continue
        times = [clock.seconds(key) or 0.0 for key in keys]
        of_flow = "flows" in where[:3]
        inside = any(clock.holds(time) or (of_flow and clock.flow_holds(time)) for time in times)
        is_one_side = min(times) > 0.0 or max(times) < 0.0
        held = mapping.get("before" if min(times) > 0.0 else "after") in (None, "hold")
        still += [".".join(map(str, where))] if len(keys) > 1 and not inside and is_one_side and held else []
        is_early |= of_flow and min(times) < 0.0
    if still:
        yield f"Nothing moves in {', '.join(still)}, whose keys are all outside. Move them into the shot."
    if is_early:
        yield (
            f"The flows begin with the subject at rest in frame {clock.frames.first}. To show a part of a "
            f"longer motion, keep its frames and write {{shot: {source.path.stem}, frames: …}} in the edit."
        )


def _light(common: Common, name: str, settings: tuple[str, ...]) -> list[str]:
    """Return what is to be said about the light of a shot, by up to LOOKED_AT of its finished frames.

    They are whole pictures, those of its draft if there are any.
    """
    project = Project(common.root, common.cores, settings=settings, profile=common.profile)
    whole = [
        each
        for each in project.rendered_requests(Show().find_shot(name))
        if QualityName.of(each.quality_name).crop is None
    ]
    if not whole:
        return []
    request = min(whole, key=lambda each: each.quality_name != "draft")
    finished = FinishedPictures(request, project.store)
    there = [n for n in sorted(request.angles) if (common.root / request.place("frame", n)).exists()]
    looked_at = there[:: -(-len(there) // LOOKED_AT) or 1]
    return FinishedPictures.light_notes({number: finished.pixels(number, 2) for number in looked_at})


def _check_scene(check: _Check, shot: Shot, first_frames: FirstFrames, written: WrittenShot) -> None:
    """Check the scene of a shot of one subject, which a file may write with others."""
    try:
        first = check.firsts[shot.subject] = first_frames.of(shot.motion)
        found = [*findings(shot, first), *_of_flows(check, shot.motion)]
        if not any(finding.is_error for finding in found):
            looped, doubts = loop_report(shot, first)
            check.notes += [f"{check.name}: {looped}"] if looped else []
            found += doubts
        check.notes += [f"{check.name}: model repaired: {line}" for line in first.repairs]
        check.notes += [f"{check.name}: model: {line}" for line in first.notes]
    except FlowsculptError as error:
        place = ("resample", "max_edge_length") if isinstance(error, FrameError) else ("subject", "model")
        found = [Finding(place, str(error), is_error=True)]
    for finding in found:
        line = f"{written.place_of(shot.subject, finding.where)}: {finding.text}"
        if finding.is_error:
            check.add_error(ShotError(line))
        elif line not in check.warnings:
            check.warnings.append(line)


def _of_flows(check: _Check, motion: Motion) -> Iterator[Finding]:
    """Yield what flows warn of, or fail for; note the rest."""
    for k, flow in enumerate(motion.flow.members):
        where = tuple(int(part) if part.isdigit() else part for part in motion.place_of_flow(k).split("."))
        where = where[2:] if where[0] == "subjects" else where  # a view adds these
        try:
            for text, is_warning in flow.findings():
                if is_warning:
                    yield Finding(where, text)
                else:
                    check.notes.append(f"{check.name}: {text}")
        except FlowsculptError as error:
            yield Finding(where, str(error), is_error=True)


def _report(common: Common, checks: list[_Check]) -> None:
    """Print errors and warnings, then which files are good, and the first frames of the shots."""
    errors = dict.fromkeys(line for check in checks for line in check.errors)
    warnings = dict.fromkeys(line for check in checks for line in check.warnings)
    if errors:
        print_error("\n".join(errors))
    if warnings:
        print_warning("\n".join(warnings))
    good = [check.name for check in checks if not check.errors and not check.warnings]
    doubtful = [check.name for check in checks if check.warnings and not check.errors]
    lines = [f"Good: {', '.join(good)}"] if good else []
    lines += [f"With warnings: {', '.join(doubtful)}"] if doubtful else []
    notes = [f"Note: {note}" for check in checks for note in check.notes]
    words = "\n".join([*(lines or ["No shot is good."]), *notes])
    print_result(Group(words, *_first_frames(checks)), [check.as_data() for check in checks], common.json)


def _first_frames(checks: list[_Check]) -> Iterator[Table]:
    """Yield a table of first frames where there are any."""
    rows = empty_table("shot", "subject", "units", "vertices", "memory")
    for check in checks:
        for name, first in check.firsts.items():
            facts = f"{first.extent:.3g}", f"{first.vertices:,}", size_words(first.memory)
            rows.add_row(check.name, f"{name}: {first.subject}" if name else first.subject, *facts)
    if rows.row_count:
        yield rows
