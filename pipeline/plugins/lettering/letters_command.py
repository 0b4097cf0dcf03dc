"""The command `letters`: begin a shot of a word, whose letters are subjects of their own."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from pipeline.cli.options import Common
from pipeline.cli.output import print_result
from pipeline.errors import UsageError
from pipeline.plugins.lettering.kinds import TextKind
from pipeline.production.request.lookup import SHOTS
from pipeline.shot.yaml.named_files import name_fault
from render.base.atomic_write import atomic_write, disk_errors

SHOT = """\
title: {title}
intent: Letters turn one after another, and stand.
frames: 1-{last}

# Each letter is a subject with flows, and if you like a look, of its own. lettering.start in place of
# lettering.text is a drop, or a ring for each hole of the letter, at the same place and of the same volume.
subjects:
{subjects}
# At most one and a half times the bevel, 0.02, so that highlights along it stay whole.
resample: {{max_edge_length: 0.03}}

look: glaze
camera: {{azimuth: {{keys: {{1: -24, {last}: -8}}}}, elevation: 8}}
"""
SUBJECT = """\
  {name}:
    lettering.text: {settings}
    flows:
      - placed:
          translate: [{x:.3g}, {y:.3g}, 0]  # the middle of the letter
          flows:
            - twist: {{axis: y, amount: {{ease: sine_in_out, keys: {{{begin}: 0, {middle}: 120, {end}: 0}}}}}}
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
) -> None:
    """Begin a shot of a word, whose letters are subjects with flows of their own.

    `flowsculpt letters A060_word FLOW` writes shots/A060_word.yaml: each letter turns and comes back, one
    after another. In place of `twist` write other flows, and give single letters looks or starts.
    """
    import shapely

    if fault := name_fault(name):
        raise UsageError(fault)
    path = SHOTS / f"{name}.yaml"
    if path.exists():
        raise UsageError(f"{path} is there already; choose another name or edit that file")
    shapes = TextKind.model_construct(text=text, font=font).shapes(SHOTS)
    entries = []
    for number, shape in enumerate(shapes, 1):
        character = shape.name[1:-1]
        is_plain = character.isascii() and character.isalnum()
        subject = f"letter{number}" if not is_plain or character.isdigit() else f"{character}{number}"
        named = f", font: {_quoted(font)}" if font else ""
        left, low, right, high = shapely.bounds(shape.region)
        begin = 1 + LATER * (number - 1)
        entries.append(
            SUBJECT.format(
                name=subject,
                settings=f"{{text: {_quoted(text)}, letter: {number}{named}}}",
                x=0.5 * (left + right),
                y=0.5 * (low + high),
                begin=begin,
                middle=begin + TURN // 2,
                end=begin + TURN,
            )
        )
    last = TURN + LATER * len(shapes) + 6
    words = SHOT.format(title=_quoted(text), last=last, subjects="".join(entries))
    if not common.dry_run:
        with disk_errors(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            with atomic_write(path) as draft:
                draft.write_text(words, encoding="utf-8")
    done = f"{path}: {common.done('written')}. Look at it: flowsculpt preview {name}"
    print_result(done, {"path": str(path), "letters": [shape.name[1:-1] for shape in shapes]}, common.json)
