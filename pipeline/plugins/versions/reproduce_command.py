"""The command `reproduce`: a published version rendered again."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.execution import execute, report_plan
from pipeline.cli.options import AllowCode, Common, Force, Frames, Variant, project_of
from pipeline.cli.output import exit_with, print_result, print_warning
from pipeline.frames import FrameRange
from pipeline.plugins.versions.reproduction import Comparison, Reproduction
from pipeline.production.request.provenance import Provenance
from pipeline.production.store.remote_store import VARIABLE


def reproduce(
    common: Common,
    provenance: Annotated[
        Path, typer.Argument(metavar="PROVENANCE", help="The provenance.json of a published version.")
    ],
    frames: Frames = None,
    variant: Variant = None,
    allow_code: AllowCode = False,
    force: Force = False,
) -> None:
    """Render a published version again, and compare it to the last bit.

    `flowsculpt reproduce renders/published/A010_cube/v001/provenance.json` renders the version in
    renders/repeated from its recorded shot file, and lists which frames are the same.
    """
    os.environ.pop(VARIABLE, None)  # what the remote store has would prove nothing
    record, project = Provenance.read(provenance), project_of(common, None, allow_code, variant)
    again = Reproduction(record, provenance, project.forcing("render") if force else project, frames)
    inside = replace(common, root=again.home)
    plan = again.plan()
    for note in again.notes:
        print_warning(f"{record.shot} {record.version}: {note}")
    if common.dry_run:
        report_plan(inside, plan)
        return
    outcome = execute(inside, again.plan)
    comparisons = again.comparisons()
    unlike = [each for each in comparisons if not each.same]
    facts = {
        "shot": record.shot,
        "version": record.version,
        "path": str(again.home),
        "notes": again.notes,
        "identical": [each.what for each in comparisons if each.same],
        "different": {each.what: each.words for each in unlike if each.same is False},
        "not_made": [each.what for each in unlike if each.same is None],
    }
    print_result(_compared(record, again.home, comparisons), facts, common.json)
    exit_with(outcome.exit_code or (1 if unlike else 0))


def _compared(record: Provenance, home: Path, comparisons: Sequence[Comparison]) -> str:
    lines = [f"{each.what}: {each.words or 'differs'}" for each in comparisons if not each.same]
    same = [each.what.removeprefix("frame ") for each in comparisons if each.same]
    frames = FrameRange.of(int(what) for what in same if what != "movie")
    numbers = [f"frame{'s' * (len(frames) > 1)} {frames}"] if frames else []
    told = [*numbers, *(["the movie"] if "movie" in same else [])]
    whole = f"{' and '.join(told) or 'nothing'} identical to the published version, bit for bit"
    return "\n".join([*lines, f"{record.shot} {record.version}: {whole}. It lies in {home}"])
