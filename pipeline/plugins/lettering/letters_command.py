"""The command `letters`: begin a shot of a word, whose letters are subjects of their own."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from flowsculpt import UsageError
from flowsculpt.api.commands import print_result
from flowsculpt.api.files import atomic_write, disk_errors, write_text
from flowsculpt.api.frames import Show
from flowsculpt.api.options import Common
from flowsculpt.api.shots import FLOW_DOCUMENTS
from flowsculpt.pipeline.plugins.lettering.kinds import TextKind

if TYPE_CHECKING:
    from flowsculpt.pipeline.plugins.lettering.outlines import OutlineShape

SHOT = """\
title: {title}
intent: {intent}
frames: 1-{last}

# Each letter is a subject with flows, and if you like a look, of its own. lettering.start in place of
# lettering.text is a drop, or a ring for each hole of the letter, at the same place and of the same volume.
subjects:
{subjects}
# At most one and a half times the bevel, 0.02, so that highlights along it stay whole.
resample: {{max_edge_length: 0.03}}

look: glaze
set: shelf  # a place with lights and a camera; others are window, spot and corner
camera: {{azimuth: {{keys: {{1: -24, {last}: -8}}}}, dolly: 1.1, move: {{push: }}}}
"""
TURNING = """\
  {name}:
    lettering.text: {settings}
    flows:
      - placed:
          translate: [{x:.3g}, {y:.3g}, 0]  # the middle of the letter
          flows:
            - twist: {{axis: y, amount: {{ease: sine_in_out, keys: {{{begin}: 0, {middle}: 120, {end}: 0}}}}}}
"""
BECOMING = """\
  {name}:
    lettering.start: {settings}
    flows:
      - become: {{model: {model}, from: {begin}, to: {end}}}
"""


def _quoted(text: str) -> str:
    """Return text as YAML has it in double quotes."""
    return json.dumps(text, ensure_ascii=False)


TURN, LATER = 36, 6
"""Frames in which a letter turns and comes back, and by which each letter begins later."""


def letters(
    common: Common,
    name: Annotated[str, typer.Argument(metavar="NAME", help="The name of the shot.")],
    text: Annotated[str, typer.Argument(metavar="TEXT", help="The word.")],
    font: Annotated[
        str,
        typer.Option(
            metavar="FONT",
            help="A TTF or OTF, named from shots/, or an installed family. Default: DejaVu Sans Bold.",
        ),
    ] = "",
    from_drops: Annotated[
        bool,
        typer.Option("--from-drops", help="Let letters begin as drops and rings that become them."),
    ] = False,
) -> None:
    """Begin a shot of a word, whose letters are subjects with flows of their own.

    `flowsculpt letters A060_word FLOW` writes shots/A060_word.yaml: each letter turns and comes back, one
    after another. In place of `twist` write other flows, and give single letters looks or starts.

    With `--from-drops` each begins as a drop, or rings with its holes, and the flow `become` carries it onto
    the letter, which is written to shots/models. Letters of several parts, such as i, cannot begin so.
    """
    if fault := Show.name_fault(name):
        raise UsageError(fault)
    path = Show().folder / f"{name}.yaml"
    if path.exists():
        raise UsageError(f"{path} is there already; choose another name or edit that file")
    if from_drops and "become" not in FLOW_DOCUMENTS:
        raise UsageError("--from-drops needs the plug-in become, which is not installed; leave it out")
    written = TextKind.model_construct(text=text, font=font)
    shapes = written.outlines(Show().folder).shapes()
    if from_drops and (several := [shape.name for shape in shapes if shape.region.geom_type != "Polygon"]):
        fact = f"become carries a surface of one part, and {several[0]} has several"
        raise UsageError(f"{fact}. Write capitals, or leave --from-drops out.")
    subjects = [_subject_name(shape, number) for number, shape in enumerate(shapes, 1)]
    models = {
        subject: Show().folder / "models" / f"{name}_{subject}.ply" for subject in subjects if from_drops
    }
    named = f", font: {_quoted(font)}" if font else ""
    entries = []
    for number, (subject, shape) in enumerate(zip(subjects, shapes, strict=True), 1):
        (x, y), begin = _middle(shape), 1 + LATER * (number - 1)
        entry = BECOMING if from_drops else TURNING
        entries.append(
            entry.format(
                name=subject,
                settings=f"{{text: {_quoted(text)}, letter: {number}{named}}}",
                model=f"models/{name}_{subject}.ply",
                x=x,
                y=y,
                begin=begin,
                middle=begin + TURN // 2,
                end=begin + TURN,
            )
        )
    last = TURN + LATER * len(shapes) + 6
    intent = f"Letters {'flow out of drops' if from_drops else 'turn'} one after another, and stand."
    words = SHOT.format(title=_quoted(text), intent=intent, last=last, subjects="".join(entries))
    if not common.dry_run:
        with disk_errors(path):
            for number, model in enumerate(models.values(), 1):
                _write_model(written.model_copy(update={"letter": number}), model)
            path.parent.mkdir(parents=True, exist_ok=True)
            write_text(path, words)
    files = [path, *models.values()]
    done = f"{', '.join(map(str, files))}: {common.done('written')}. Look at it: flowsculpt preview {name}"
    facts = {"path": str(path), "files": [str(file) for file in files], "subjects": subjects}
    print_result(done, facts, common.json)


def _subject_name(shape: OutlineShape, number: int) -> str:
    """Return a name for the subject of a letter: F1, or letter2 for what names cannot have."""
    character = shape.name[1:-1]
    return f"{character}{number}" if re.fullmatch("[A-Za-z]+", character) else f"letter{number}"


def _middle(shape: OutlineShape) -> tuple[float, float]:
    left, low, right, high = shape.region.bounds
    return 0.5 * (left + right), 0.5 * (low + high)


def _write_model(letter: TextKind, path: Path) -> None:
    """Write the solid of a letter as PLY."""
    import trimesh

    mesh = letter.surface(Show().folder)
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(path) as draft:
        draft.write_bytes(trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(file_type="ply"))
