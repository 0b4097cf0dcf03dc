"""Checks of a shot file and, if it is well written, of the scene that it describes."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from flowsculpt import FlowsculptError, FrameError
from flowsculpt.api import ShotError
from flowsculpt.api.shots import Clock, Motion, Shot, WrittenShot, YamlSource, read_shot
from flowsculpt.pipeline.plugins.authoring.first_frame import FirstFrame, FirstFrames
from flowsculpt.pipeline.plugins.authoring.scene_rules import Finding, below_floor, findings, loop_report
from flowsculpt.pipeline.plugins.authoring.verdict import Verdict


def check_shot(
    verdict: Verdict, path: Path, settings: tuple[str, ...], first_frames: FirstFrames
) -> Shot | None:
    """Add what is to be said about a shot file and its scene; return the shot, None where it has mistakes."""
    try:
        shot, written = read_shot(path, settings=settings), WrittenShot.read(path, settings=settings)
    except FlowsculptError as error:
        verdict.add_error(error)
        return None
    name, outside = verdict.name, written.outside_note(shot.motion.clock)
    if outside:
        verdict.warnings.append(" ".join([outside, *_of_outer_keys(written.source, shot.motion.clock)]))
    verdict.notes += [f"{name}: {line}" for line in shot.notes if line != outside]
    firsts = [_check_scene(verdict, part, first_frames, written) for part in shot.parts]
    if shot.subjects and all(firsts):
        points = np.concatenate([first.points for first in firsts if first])
        for finding in below_floor(shot, points):
            verdict.warnings.append(f"{written.place_of('', finding.where)}: {finding.text}")
    verdict.notes = list(dict.fromkeys(verdict.notes))
    return shot


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


def _check_scene(
    verdict: Verdict, shot: Shot, first_frames: FirstFrames, written: WrittenShot
) -> FirstFrame | None:
    """Check the scene of a shot of one subject, which a file may write with others; return its first frame,
    None where it fails."""
    first = None
    try:
        first = first_frames.of(shot.motion)
        verdict.firsts[shot.subject] = first.as_data()
        found = [*findings(shot, first), *_of_flows(verdict, shot.motion)]
        if not any(finding.is_error for finding in found):
            looped, doubts = loop_report(shot, first)
            verdict.notes += [f"{verdict.name}: {looped}"] if looped else []
            found += doubts
        verdict.notes += [f"{verdict.name}: model repaired: {line}" for line in first.repairs]
        verdict.notes += [f"{verdict.name}: model: {line}" for line in first.notes]
    except FrameError as error:
        place = ("flows",) if first else ("resample", "max_edge_length")
        of_flows = [finding for finding in _of_flows(verdict, shot.motion) if finding.is_error]
        found = of_flows or [Finding(place, str(error), is_error=True)]
    except FlowsculptError as error:
        found = [Finding(("subject", "model"), str(error), is_error=True)]
    for finding in found:
        line = f"{written.place_of(shot.subject, finding.where)}: {finding.text}"
        if finding.is_error:
            verdict.add_error(ShotError(line))
        elif line not in verdict.warnings:
            verdict.warnings.append(line)
    return first


def _entries(flow: Any) -> int:
    """Return how many entries of `flows` a flow holds: those before it too, if it acts around them."""
    return 1 + (sum(map(_entries, flow.flows)) if flow.acts_around_earlier else 0)


def _of_flows(verdict: Verdict, motion: Motion) -> Iterator[Finding]:
    """Yield what flows warn of, or fail for; note the rest."""
    entry = -1
    for flow in motion.flow.members:
        entry += _entries(flow)
        where = tuple(int(x) if x.isdigit() else x for x in motion.place_of_flow(entry).split("."))
        where = where[2:] if where[0] == "subjects" else where  # a view adds these
        try:
            for text, is_warning in flow.findings():
                if is_warning:
                    yield Finding(where, text)
                else:
                    verdict.notes.append(f"{verdict.name}: {text}")
        except FlowsculptError as error:
            yield Finding(where, str(error), is_error=True)
