"""The command `versions`: list published versions."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from pipeline.cli.options import Common
from pipeline.cli.output import answer, complain, out
from pipeline.errors import MissingInputError
from pipeline.frames import FrameRange
from pipeline.production.store.paths import PUBLISHED, published
from pipeline.production.versions.provenance import FILE, Provenance, records


def versions(
    common: Common,
    shot: Annotated[
        str | None, typer.Argument(metavar="SHOT", help="The shot's name; by default all that are published.")
    ] = None,
) -> None:
    """List what is published: each version's quality, frames, date, user and note."""
    home = common.root / PUBLISHED
    known = sorted(place.name for place in home.glob("*") if place.is_dir())
    name = None if shot is None else Path(shot).stem if shot.endswith((".yaml", ".yml")) else shot
    if name is not None and name not in known:
        there = f"published are {', '.join(known)}" if known else "nothing is, yet"
        raise MissingInputError(
            f"{name} is not published in {home}; {there}. flowsculpt publish {name} does it"
        )
    found, failed = [], []
    for each in known if name is None else [name]:
        for place, record in records(common.root / published(each)):
            if isinstance(record, Provenance):
                found.append((place, record))
            else:
                failed.append(record)
    for error in failed:
        complain(str(error))
    _tell_versions(found, common.json)
    if failed:
        raise typer.Exit(max(error.exit_code for error in failed))


def _tell_versions(found: Sequence[tuple[Path, Provenance]], as_json: bool) -> None:
    if as_json:
        answer("", [_facts(place, record) for place, record in found], as_json=True)
        return
    table = Table(box=None, pad_edge=False)
    for heading in ("shot", "version", "quality", "frames", "published (UTC)", "by", "note"):
        table.add_column(heading)
    for _, record in found:
        when = record.published.replace("T", " ").removesuffix("Z")
        frames = str(FrameRange.of(record.frames))
        row = (
            record.shot,
            record.version,
            record.quality,
            frames,
            when,
            record.user or "–",
            record.note or "–",
        )
        table.add_row(*(word.replace("[", r"\[") for word in row))
    out.print(table if found else "Nothing is published here; flowsculpt publish does it.")


def _facts(place: Path, record: Provenance) -> dict[str, Any]:
    names = ("shot", "version", "title", "quality", "variant", "published", "user", "note")
    return {
        **{name: getattr(record, name) for name in names},
        "frames": list(record.frames),
        "path": str(place),
        "provenance": str(place / FILE),
    }
