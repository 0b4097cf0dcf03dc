"""Commands for writing shots: new, schema."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from pipeline.cli.options import Common
from pipeline.cli.say import answer
from pipeline.errors import FlowsculptError, UsageError, suggestion
from pipeline.production.request.lookup import NAME, SHOTS, find_shot, shot_names
from pipeline.production.store.disk import disk_faults
from pipeline.shot import read_shot
from pipeline.shot.documents.catalogue import DOCUMENTS
from pipeline.shot.documents.schema import defaults_schema, film_schema, shot_schema
from pipeline.shot.templates.flow_presets import STAGED, staging_of
from pipeline.shot.templates.template import SCHEMA, shot_of_flow, shot_of_shot
from pipeline.shot.yaml.edits import DEFAULTS
from pipeline.shot.yaml.source import Source

SCHEMAS = Path(".schema")
"""Beside shots: the folder of the schemas that editors check them by."""

FOLDERS = ("film", "published", "repeated", "turntable", "wedge")
"""In renders/, where shots have theirs: no shot may be called so."""


def new(
    common: Common,
    name: Annotated[str, typer.Argument(help="The shot's name, as its file and its frames are called.")],
    source: Annotated[
        str,
        typer.Option(
            "--from",
            metavar="FLOW|SHOT",
            help="A flow, staged on a subject that suits it; or a shot, by name or path, to be copied.",
        ),
    ] = "twist",
) -> None:
    """Begin a shot: write shots/NAME.yaml, ready to render and to be changed.

    Beside it go the schemas by which editors complete and check shot files, in shots/.schema, and a file
    that the flow reads, where it needs one.
    """
    if not re.fullmatch(NAME, name) or name in (*FOLDERS, Path(DEFAULTS).stem):
        raise UsageError(f"{name!r} cannot name a shot; use letters, digits, _ and -, as in A010_cube")
    path = SHOTS / f"{name}.yaml"
    if path.exists():
        raise UsageError(f"{path} is there already; choose another name or edit that file")
    text, beside = _beginning(source, name)
    files = [path, *beside]
    for file in beside:
        if file.exists():
            raise UsageError(f"{file} is there already, and {source} would write one; choose another name")
    if not common.dry_run:
        with disk_faults(path):
            write_schemas(SHOTS)
            for file, write in beside.items():
                write(file)
            path.write_text(SCHEMA.format((SCHEMAS / "shot.json").as_posix()) + text, encoding="utf-8")
    written = ", ".join(map(str, files))
    permitted = " --allow-code" if source == "python" else ""
    done = f"{written}: written. Look at it: flowsculpt render {name} -q preview{permitted}"
    facts = {"path": str(path), "files": [str(file) for file in files]}
    answer(f"{written}: would be written." if common.dry_run else done, facts, common.json)


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
        with disk_faults(output):
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
        data = Source.read(folder / DEFAULTS).data
    except FlowsculptError:
        return []
    return list(data) if isinstance(data, dict) else []


def _beginning(source: str, name: str) -> tuple[str, dict[Path, Callable[[Path], None]]]:
    """The text of a new shot, and the files beside it with what writes them."""
    if source in DOCUMENTS:
        beside = staging_of(source).beside
        return shot_of_flow(source, name), {SHOTS / f"{name}{beside[0]}": beside[1]} if beside else {}
    known = shot_names()
    if source not in known and not source.endswith((".yaml", ".yml")):
        raise UsageError(
            f"there is no flow and no shot {source!r} to begin from. {suggestion(source, [*known, *STAGED])}"
        )
    text = shot_of_shot(find_shot(source).read_text(encoding="utf-8"), name)
    try:
        read_shot(SHOTS / f"{name}.yaml", text)
    except FlowsculptError as error:
        first = str(error).splitlines()[0]
        raise UsageError(f"a copy of {source} would not be good in {SHOTS}/: {first}") from None
    return text, {}
