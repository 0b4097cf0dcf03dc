"""The commands `schema` and `flows`: what shot files may hold."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic import BaseModel
from rich.console import Group
from rich.text import Text

from flowsculpt import FlowsculptError, MachineError
from flowsculpt.api.commands import empty_table, print_result, require_one_of
from flowsculpt.api.files import write_text
from flowsculpt.api.frames import Show
from flowsculpt.api.options import Common, shared_option
from flowsculpt.pipeline.plugins.authoring import shot_schemas
from flowsculpt.pipeline.plugins.authoring.reference import kept
from flowsculpt.pipeline.plugins.authoring.shot_schemas import (
    default_text,
    defaults_schema,
    facts,
    film_schema,
    markdown,
    shot_schema,
)
from flowsculpt.pipeline.plugins.authoring.shot_templates import usual_strength

SCHEMAS = Path(".schema")
"""The folder beside shots with the schemas by which editors check them."""

KINDS = ("shot", "film", "defaults")
"""Kinds of files beside shots, which editors check."""


def _models() -> dict[str, tuple[str, Any]]:
    """Return the models of further kinds of files, each with the plug-in that has it."""
    from flowsculpt.api import ShotExtras

    extras = ShotExtras.of_plugins().items()
    return {kind: (plugin, model) for plugin, each in extras for kind, model in each.schemas().items()}


ALL_KINDS = (*KINDS, *kept("kinds", lambda: [*_models()]))
"""Kinds beside shots, and those of plug-ins."""


def schema(
    common: Common,
    kind: Annotated[str, typer.Argument(metavar="|".join(ALL_KINDS), help="The kind of file.")] = KINDS[0],
    output: Annotated[Path | None, shared_option("output", "Write it to this file.")] = None,
) -> None:
    """Print the JSON Schema by which editors complete and check shot files.

    `flowsculpt schema film -o film.json` writes the schema of edits, `flowsculpt schema notes` prints that
    of files of notes, which the page of `review` downloads. In the schema of shots, names that
    shots/defaults.yaml gives are not required.
    """
    require_one_of(kind, ALL_KINDS, f"{kind!r} has no schema.")
    content = _schema_of(kind, Show().folder)
    if output is None:
        print_result(_as_text(content), content, common.json)
        return
    if not common.dry_run:
        write_text(output, _as_text(content))
    print_result(f"{output}: {common.done('written')}.", {"path": str(output)}, common.json)


def write_schemas(folder: Path) -> None:
    """Write the schemas of a folder of shots, unless they are up to date."""
    (folder / SCHEMAS).mkdir(parents=True, exist_ok=True)
    for kind in KINDS:
        file, text = folder / SCHEMAS / f"{kind}.json", _as_text(_schema_of(kind, folder))
        if not file.is_file() or file.read_text(encoding="utf-8") != text:
            write_text(file, text)


def _schema_of(kind: str, folder: Path) -> dict[str, Any]:
    if kind == "shot":
        return shot_schema(defaults_of(folder))
    if kind == "film":
        return film_schema()
    if kind == "defaults":
        return defaults_schema()
    return kept(f"plug-in's schema of {kind}", lambda: _of_plugin(kind))


def _of_plugin(kind: str) -> dict[str, Any]:
    """Return the schema of a plug-in's kind of files. Raises MachineError for a model of another type."""
    plugin, model = _models()[kind]
    if not (isinstance(model, type) and issubclass(model, BaseModel)):
        raise MachineError(
            f"plug-in {plugin}: its schema {kind} is a {type(model).__name__}; it must be a class that "
            "extends pydantic's BaseModel"
        )
    return model.model_json_schema()


def _as_text(content: dict[str, Any]) -> str:
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"


def defaults_of(folder: Path) -> Mapping[str, Any]:
    """Return the defaults of a folder; empty if they cannot be read."""
    if not (folder / Show().defaults.name).exists():
        return {}
    from flowsculpt.api.shots import YamlSource  # takes time to import

    try:
        data = YamlSource.read(folder / Show().defaults.name).data
    except FlowsculptError:
        return {}
    return data if isinstance(data, dict) else {}


def flows(
    common: Common,
    name: Annotated[str | None, typer.Argument(metavar="FLOW", help="One flow, with its parameters.")] = None,
    as_markdown: Annotated[
        bool, typer.Option("--markdown", help="The table of all flows as docs/flows.md has it.")
    ] = False,
) -> None:
    """List the flows, or the parameters of one with units and defaults.

    `flowsculpt flows vortex` lists the parameters of the flow `vortex`, and strengths that suit a ball of
    radius 1.
    """
    if name is not None:
        _report_one({**facts(name), "strength": usual_strength(name)}, common.json)
        return
    flows = [*shot_schemas.flows().values()]
    listing = empty_table("flow", "is a", "what it does")
    for flow in flows:
        listing.add_row(flow["name"], flow["kind"], flow["description"])
    print_result(markdown() if as_markdown else listing, flows, common.json)


def _report_one(flow: dict[str, Any], as_json: bool) -> None:
    listing = empty_table("parameter", "default", "unit", "what it is")
    for parameter in flow["parameters"]:
        choices = f": {', '.join(parameter['choices'])}" if parameter["choices"] else ""
        keyed = ", may be keyed" if parameter["keyed"] else ""
        listing.add_row(
            parameter["name"],
            default_text(parameter),
            parameter["unit"],
            f"{parameter['description']}{choices}{keyed}",
        )
    title = Text(f"{flow['name']}, a {flow['kind']}. {flow['description']}")
    strength = flow["strength"]
    suits = [] if strength is None else [Text(_suitable(*strength))]
    print_result(Group(title, listing, *suits), flow, as_json)


def _suitable(parameter: str, values: Sequence[float]) -> str:
    """Return what strengths do: `strength 4.1 gives a ball of radius 1 twice its vertices in 3 s, 15 …`"""
    twice, *tenfold = values
    more = f", {tenfold[0]:g} ten times" if tenfold else ""
    return (
        f"{parameter} {twice:g} gives a ball of radius 1 twice its vertices in 3 s{more}; other parameters "
        "at their defaults."
    )
