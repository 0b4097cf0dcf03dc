"""The command `schema`: the JSON Schemas of shot files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from pipeline.cli.options import Common
from pipeline.cli.output import answer
from pipeline.errors import FlowsculptError, UsageError, suggestion
from pipeline.production.request.lookup import SHOTS
from pipeline.shot.documents.schema import defaults_schema, film_schema, shot_schema
from pipeline.shot.yaml.lookup import DEFAULTS
from pipeline.shot.yaml.source import YamlSource
from render.base.atomic_write import disk_errors

SCHEMAS = Path(".schema")
"""Beside shots: the folder of the schemas that editors check them by."""


def schema(
    common: Common,
    of: Annotated[str, typer.Argument(metavar="shot|film|defaults", help="Of which files.")] = "shot",
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="Write it there instead.")
    ] = None,
) -> None:
    """Print the JSON Schema of shot files, by which editors complete and check them.

    It is for shots beside shots/defaults.yaml, if there is one: what that says need not be said again.
    """
    makers = {"shot": lambda: shot_schema(_said(SHOTS)), "film": film_schema, "defaults": defaults_schema}
    if of not in makers:
        raise UsageError(f"there is no schema of {of!r}. {suggestion(of, makers)}")
    made = makers[of]()
    if output is None:
        answer(_written(made), made, common.json)
        return
    if not common.dry_run:
        with disk_errors(output):
            output.parent.mkdir(parents=True, exist_ok=True)
            output.write_text(_written(made), encoding="utf-8")
    done = f"{output}: {'would be ' if common.dry_run else ''}written."
    answer(done, {"path": str(output)}, common.json)


def write_schemas(folder: Path) -> None:
    """The schemas of the files in a folder of shots, where they are not there as they should be."""
    made = {"shot": shot_schema(_said(folder)), "film": film_schema(), "defaults": defaults_schema()}
    (folder / SCHEMAS).mkdir(parents=True, exist_ok=True)
    for name, schema_of in made.items():
        file, text = folder / SCHEMAS / f"{name}.json", _written(schema_of)
        if not file.is_file() or file.read_text(encoding="utf-8") != text:
            file.write_text(text, encoding="utf-8")


def _written(schema_of: dict[str, Any]) -> str:
    return json.dumps(schema_of, indent=1, ensure_ascii=False) + "\n"


def _said(folder: Path) -> list[str]:
    """The names that the defaults of a folder say; none where these cannot be read."""
    try:
        data = YamlSource.read(folder / DEFAULTS).data
    except FlowsculptError:
        return []
    return list(data) if isinstance(data, dict) else []
