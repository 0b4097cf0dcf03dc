"""Outlines and solids, made from fonts and drawings in a process of its own with limited memory and time.

A drawing of a few bytes may repeat itself without end or cross itself a million times, and GEOS, which finds
the crossings, does not hear Ctrl-C.
"""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely

from flowsculpt import TriangleMesh, UsageError
from flowsculpt.api import plural
from flowsculpt.api.files import InputFile, Parser
from flowsculpt.pipeline.plugins.lettering.extrusion import Section, extruded, solids
from flowsculpt.pipeline.plugins.lettering.outlines import OutlineShape
from flowsculpt.pipeline.plugins.lettering.starts import starts
from flowsculpt.pipeline.plugins.lettering.svg_outlines import drawn_shapes
from flowsculpt.pipeline.plugins.lettering.text_outlines import TextSettings, letters

READING, EXTRUDING = 6.0, 60.0
"""Seconds of a core that outlines may take, and solids."""

MOST_POINTS, MOST_KNOWN = 100_000, 32
"""Points of all outlines of a text or a drawing; texts and drawings whose outlines are kept."""

Key = tuple[Path, str, str]
"""A file, its digest, and what outlines are asked of it."""

_known: dict[Key, tuple[OutlineShape, ...]] = {}
"""Outlines that were read last: each letter of a word may be a subject."""


class Outlines(NamedTuple):
    """What outlines are read from.

    path      of a font or a drawing
    settings  of `TextSettings` with the text itself, or of `drawn_shapes`
    noun      `letter` or `path`
    number    of the one to keep, from 1; None for all

    Its methods raise UsageError where the outlines or what is made of them cannot be.
    """

    path: Path
    settings: Mapping[str, Any]
    noun: str
    number: int | None = None

    def shapes(self) -> Sequence[OutlineShape]:
        key = self._key
        if key not in _known:
            self._ask({})
        return self._chosen(_known[key])

    def solid(self, profile: Section) -> TriangleMesh:
        """Return the solids of all shapes; those that overlap are one."""
        return self._ask({"profile": asdict(profile)})

    def start(self, depth: float) -> TriangleMesh:
        """Return the start shapes."""
        return self._ask({"start": depth})

    @property
    def _key(self) -> Key:
        return self.path, InputFile(self.path).digest(), json.dumps(self.settings)

    def _ask(self, wanted: Mapping[str, Any]) -> TriangleMesh:
        """Have the outlines, and a mesh of them if one is wanted, made in a process of its own."""
        _, digest, settings = key = self._key
        options = (digest, settings, self.noun, json.dumps(self.number), json.dumps(wanted))
        if wanted:
            _load_kernels()
        try:
            head, _, arrays = Parser.answer_of_fork(_answer, self.path, *options).partition(b"\n")
        except ValueError as error:
            raise UsageError(f"{self.path.name} cannot be read: {error}. Simplify it.") from None
        facts = json.loads(head)
        if "fault" in facts:
            raise UsageError(facts["fault"])
        if facts["shapes"] is not None:
            _remember(key, tuple(OutlineShape(name, shapely.from_wkb(wkb)) for name, wkb in facts["shapes"]))
        if not wanted:
            return TriangleMesh(np.empty((0, 3)), np.empty((0, 3)))
        with np.load(io.BytesIO(arrays), allow_pickle=False) as mesh:
            return TriangleMesh(mesh["vertices"], mesh["faces"], creases=mesh["creases"])

    def _chosen(self, shapes: Sequence[OutlineShape]) -> Sequence[OutlineShape]:
        """Return the shape of the number, or all. Raises UsageError for a number beyond the last."""
        if self.number is None:
            return shapes
        if self.number > len(shapes):
            fact = f"{self.noun} {self.number} is beyond the last: it has {plural(len(shapes), self.noun)}"
            raise UsageError(f"{fact}. Write {self.noun}: {len(shapes)}.")
        return shapes[self.number - 1 : self.number]


@cache
def _load_kernels() -> None:
    """Load the compiled functions that solids take, so that forks have them."""
    extruded(shapely.box(0.0, 0.0, 1.0, 1.0), Section(1.0))


def _answer(path: str, digest: str, settings: str, noun: str, number: str, wanted: str) -> bytes:
    """Return a line of JSON with the outlines where they are not known yet, and a mesh as npz."""
    Parser.allow_memory(Parser.MEMORY)
    Parser.allow_seconds(READING)
    outlines = Outlines(Path(path), json.loads(settings), noun, json.loads(number))
    key = outlines.path, digest, settings
    try:
        is_known = key in _known
        shapes = _known[key] if is_known else read_outlines(outlines)
        Parser.allow_seconds(EXTRUDING)
        mesh = mesh_bytes(outlines._chosen(shapes), **json.loads(wanted))
    except UsageError as error:
        return json.dumps({"fault": str(error)}).encode()
    sent = None if is_known else [(shape.name, shapely.to_wkb(shape.region, hex=True)) for shape in shapes]
    return json.dumps({"shapes": sent}).encode() + b"\n" + mesh


def read_outlines(outlines: Outlines) -> tuple[OutlineShape, ...]:
    """Return all shapes of a font or drawing. Raises UsageError where they cannot be made."""
    given = dict(outlines.settings)
    if "text" in given:
        text, axes = given.pop("text"), tuple(map(tuple, given.pop("axes")))
        shapes = letters(text, TextSettings(outlines.path, axes=axes, **given))
    else:
        shapes = drawn_shapes(outlines.path, **given)
    count = int(sum(shapely.get_num_coordinates(shape.region) for shape in shapes))
    if count > MOST_POINTS:
        fact = f"its outlines have {count} points; the most is {MOST_POINTS}"
        raise UsageError(f"{outlines.path.name}: {fact}. Simplify it, or raise tolerance.")
    return shapes


def mesh_bytes(
    shapes: Sequence[OutlineShape], profile: Mapping[str, Any] | None = None, start: float | None = None
) -> bytes:
    """Return solids or start shapes of shapes as npz; nothing where neither is wanted."""
    if profile is None and start is None:
        return b""
    mesh = solids(shapes, Section(**profile)) if profile is not None else starts(shapes, start or 0.0)
    file = io.BytesIO()
    np.savez(file, vertices=mesh.vertices, faces=mesh.faces, creases=mesh.creases)
    return file.getvalue()


def _remember(key: Key, shapes: tuple[OutlineShape, ...]) -> None:
    if len(_known) >= MOST_KNOWN:
        _known.clear()
    _known[key] = shapes


if __name__ == "__main__":
    Parser.serve(_answer)
