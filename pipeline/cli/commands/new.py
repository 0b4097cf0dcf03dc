"""The command `new`: begin a shot."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.commands.schema import SCHEMAS, write_schemas
from pipeline.cli.options import Common
from pipeline.cli.output import print_result
from pipeline.errors import FlowsculptError, UsageError, suggestion
from pipeline.production.request.lookup import NAME, SHOTS, find_shot, shot_names
from pipeline.shot import read_shot
from pipeline.shot.documents.flow_documents import DOCUMENTS
from pipeline.shot.templates import FLOW_FILES, SCHEMA, presets, shot_of_flow, shot_of_shot
from pipeline.shot.yaml.lookup import DEFAULTS
from render.base.atomic_write import disk_errors

RESERVED = ("film", "published", "repeated", "turntable", "wedge", Path(DEFAULTS).stem)
"""Names that no shot may have: folders in renders/ beside those of shots, and the file of defaults."""


def new(
    common: Common,
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="The name of the shot, its file and its frames.")
    ],
    source: Annotated[
        str,
        typer.Option(
            "--from",
            metavar="FLOW|SHOT",
            help="A flow, with a subject that suits it; or the name or path of a shot to copy.",
        ),
    ] = "twist",
) -> None:
    """Begin a shot: write a shot file that is ready to render.

    `flowsculpt new A020_ring --from vortex_ring` writes shots/A020_ring.yaml; `--from A010_cube` would copy
    that shot. `flowsculpt flows` lists the flows.

    The schemas by which editors complete and check shot files are written to shots/.schema, and a file that
    the flow reads beside the shot.
    """
    if not re.fullmatch(NAME, name) or name in RESERVED:
        raise UsageError(f"{name!r} cannot name a shot; use letters, digits, _ and -, as in A010_cube")
    path = SHOTS / f"{name}.yaml"
    if path.exists():
        raise UsageError(f"{path} is there already; choose another name or edit that file")
    text, beside = _contents(source, name)
    files = [path, *beside]
    for file in beside:
        if file.exists():
            raise UsageError(f"{file} is there already, and {source} would write one; choose another name")
    if not common.dry_run:
        with disk_errors(path):
            write_schemas(SHOTS)
            for file, write in beside.items():
                write(file)
            path.write_text(SCHEMA.format((SCHEMAS / "shot.json").as_posix()) + text, encoding="utf-8")
    written = ", ".join(map(str, files))
    permitted = " --allow-code" if source == "python" else ""
    done = f"{written}: written. Look at it: flowsculpt render {name}{permitted}"
    facts = {"path": str(path), "files": [str(file) for file in files]}
    print_result(f"{written}: would be written." if common.dry_run else done, facts, common.json)


def _contents(source: str, name: str) -> tuple[str, dict[Path, Callable[[Path], None]]]:
    """Return the text of a new shot, and by path the functions that write files beside it."""
    if source in DOCUMENTS:
        beside = FLOW_FILES.get(source)
        return shot_of_flow(source, name), {SHOTS / f"{name}{beside[0]}": beside[1]} if beside else {}
    known = shot_names()
    if source not in known and not source.endswith((".yaml", ".yml")):
        hint = suggestion(source, [*known, *presets()])
        raise UsageError(f"there is no flow and no shot {source!r} to begin from. {hint}")
    text = shot_of_shot(find_shot(source).read_text(encoding="utf-8"), name)
    try:
        read_shot(SHOTS / f"{name}.yaml", text)
    except FlowsculptError as error:
        first = str(error).splitlines()[0]
        raise UsageError(f"a copy of {source} would not be good in {SHOTS}/: {first}") from None
    return text, {}
