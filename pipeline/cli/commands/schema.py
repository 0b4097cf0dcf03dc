"""The command `schema`: the JSON Schemas of shot files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from pipeline.cli.options import Common, output_option, require_one_of
from pipeline.cli.output import print_result
from pipeline.errors import FlowsculptError
from pipeline.production.request.lookup import SHOTS
from pipeline.shot.documents.reference import defaults_schema, film_schema, shot_schema
from pipeline.shot.yaml.lookup import DEFAULTS
from pipeline.shot.yaml.source import YamlSource
from render.base.atomic_write import disk_errors

SCHEMAS = Path(".schema")
"""The folder beside shots with the schemas by which editors check them."""

KINDS = ("shot", "film", "defaults")


def schema(
    common: Common,
    kind: Annotated[str, typer.Argument(metavar="|".join(KINDS), help="The kind of file.")] = KINDS[0],
    output: Annotated[Path | None, output_option("Write it to this file.")] = None,
) -> None:
    """Print the JSON Schema by which editors complete and check shot files.

    `flowsculpt schema film -o film.json` writes the schema of edits. In the schema of shots, names that
    shots/defaults.yaml gives are not required.
    """
    require_one_of(kind, KINDS, f"there is no schema of {kind!r}.")
    content = _schema_of(kind, SHOTS)
    if output is None:
        print_result(_as_text(content), content, common.json)
        return
    if not common.dry_run:
        with disk_errors(output):
            output.parent.mkdir(parents=True, exist_ok=True)
            output.write_text(_as_text(content), encoding="utf-8")
    print_result(f"{output}: {common.done('written')}.", {"path": str(output)}, common.json)


def write_schemas(folder: Path) -> None:
    """Write the schemas of a folder of shots, unless they are up to date."""
    (folder / SCHEMAS).mkdir(parents=True, exist_ok=True)
    for kind in KINDS:
        file, text = folder / SCHEMAS / f"{kind}.json", _as_text(_schema_of(kind, folder))
        if not file.is_file() or file.read_text(encoding="utf-8") != text:
            file.write_text(text, encoding="utf-8")


def _schema_of(kind: str, folder: Path) -> dict[str, Any]:
    if kind == "shot":
        return shot_schema(names_with_defaults(folder))
    return film_schema() if kind == "film" else defaults_schema()


def _as_text(content: dict[str, Any]) -> str:
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"


def names_with_defaults(folder: Path) -> list[str]:
    """Return the names that the defaults of a folder give; none if they cannot be read."""
    try:
        data = YamlSource.read(folder / DEFAULTS).data
    except FlowsculptError:
        return []
    return list(data) if isinstance(data, dict) else []
