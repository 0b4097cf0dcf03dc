"""The command `versions`: list published versions."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from pipeline.cli.options import Common
from pipeline.cli.output import exit_with, print_error, print_result, table
from pipeline.errors import MissingInputError
from pipeline.frames import FrameRange
from pipeline.production.store.paths import PUBLISHED, published
from pipeline.production.versions.provenance import FILE, Provenance, records


def versions(
    common: Common,
    shot: Annotated[
        str | None, typer.Argument(metavar="SHOT", help="A shot's name. Default: all published shots.")
    ] = None,
) -> None:
    """List published versions with quality, frames, date, user and note.

    `flowsculpt versions A010_cube` lists the versions that `flowsculpt publish A010_cube` made.
    """
    home = common.root / PUBLISHED
    known = sorted(folder.name for folder in home.glob("*") if folder.is_dir())
    name = None if shot is None else Path(shot).stem if shot.endswith((".yaml", ".yml")) else shot
    if name is not None and name not in known:
        there = f"published are {', '.join(known)}" if known else "nothing is, yet"
        raise MissingInputError(
            f"{name} is not published in {home}; {there}. flowsculpt publish {name} does it"
        )
    provenances, errors = [], []
    for each in known if name is None else [name]:
        for folder, record in records(common.root / published(each)):
            if isinstance(record, Provenance):
                provenances.append((folder, record))
            else:
                errors.append(record)
                print_error(str(record))
    _report(provenances, common.json)
    exit_with(max((error.exit_code for error in errors), default=0))


def _report(provenances: Sequence[tuple[Path, Provenance]], as_json: bool) -> None:
    listing = table("shot", "version", "quality", "frames", "published (UTC)", "by", "note")
    for _, record in provenances:
        when = record.published.replace("T", " ").removesuffix("Z")
        frames = str(FrameRange.of(record.frames))
        who, note = record.user or "–", record.note or "–"
        row = (record.shot, record.version, record.quality, frames, when, who, note)
        listing.add_row(*(word.replace("[", r"\[") for word in row))
    words = listing if provenances else "Nothing is published here; flowsculpt publish does it."
    print_result(words, [_facts(folder, record) for folder, record in provenances], as_json)


def _facts(folder: Path, record: Provenance) -> dict[str, Any]:
    names = ("shot", "version", "title", "quality", "variant", "published", "user", "note")
    return {
        **{name: getattr(record, name) for name in names},
        "frames": list(record.frames),
        "path": str(folder),
        "provenance": str(folder / FILE),
    }
