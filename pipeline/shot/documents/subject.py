"""What a shot file says of a subject that is points, a cloud or a net, and the subject it becomes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Discriminator, Field, Tag

from pipeline.errors import MeshError, MissingInputError
from pipeline.mesh.control_net import LEAST, Lattice
from pipeline.mesh.io.points import read_net, read_points
from pipeline.shot.documents.fields import Document, Positive, Triple, one_of
from pipeline.shot.point_subjects import (
    MOST_POINTS,
    NETS,
    Cloud,
    CloudInSolid,
    CloudOfFile,
    ControlNet,
    NetOfFile,
    NetOfRows,
    NetOfSolid,
    radii_of,
)
from pipeline.shot.subject import SOLIDS, Solid
from pipeline.shot.yaml.lookup import digest_of_file, is_there
from pipeline.shot.yaml.source import Source, Where

CLOSED = {"none": (False, False), "rows": (True, False), "columns": (False, True), "both": (True, True)}
"""Which ends of a net follow each other: the last row and the first, the last column and the first."""

_BELONG = {
    "cloud": {"a file": ("scale",), "a solid": ("count", "fill", "seed")},
    "net": {
        "a file": ("columns", "closed", "scale"),
        "rows": ("closed",),
        "a solid": ("rows", "columns"),
    },
}
"""By what a subject is made from, a file, rows or a solid: what else can be said of it."""


def _measures(schema: dict[str, Any]) -> None:
    """Each solid has measures of its own: told to editors as `checks.solid` tells it to people."""
    every = {measure for kind in SOLIDS.values() for measure in kind.measures}
    schema["allOf"] = [
        {
            "if": {"properties": {"solid": {"const": name}}, "required": ["solid"]},
            "then": {"properties": _of_solid(kind.measures, every)},
        }
        for name, kind in SOLIDS.items()
    ]


def _of_solid(measures: Mapping[str, Any], every: set[str]) -> dict[str, Any]:
    """What the measures of a solid can be beyond what those of all can: lists as long as its own."""
    many = {name: len(value) for name, value in measures.items() if isinstance(value, tuple)}
    exact = {name: {"minItems": n, "maxItems": n} for name, n in many.items()}
    return exact | dict.fromkeys(sorted(every - measures.keys()), False)


class SolidDocument(Document):
    """Which of the measures a solid takes is for `checks` to say."""

    model_config = ConfigDict(json_schema_extra=_measures)

    solid: Annotated[str, one_of(SOLIDS, "solid")]
    size: list[Positive] | None = Field(None, min_length=2, max_length=3)
    radius: Positive | None = None
    length: Positive | None = None
    tube_radius: Positive | None = None
    spacing: Positive | None = None
    thickness: Positive | None = None
    caps: Literal["round", "flat"] | None = None

    def build(self) -> Solid:
        return Solid.of(self.solid, self.model_dump(exclude_none=True, exclude={"solid"}))


class NetSolidDocument(Document):
    solid: Annotated[str, one_of(NETS, "net")]
    size: list[Positive] | None = Field(None, min_length=2, max_length=2)
    radius: Positive | None = None
    length: Positive | None = None
    tube_radius: Positive | None = None


def _form(value: Any) -> str:
    return "a solid" if isinstance(value, dict) else "rows" if isinstance(value, list) else "a file"


class CloudDocument(Document):
    """radius: a number, or the name of an attribute of the file"""

    cloud: Annotated[
        Annotated[str, Tag("a file")] | Annotated[SolidDocument, Tag("a solid")],
        Discriminator(lambda value: "a solid" if isinstance(value, dict) else "a file"),
    ]
    radius: Annotated[
        Annotated[Positive, Tag("number")] | Annotated[str, Tag("name")],
        Discriminator(lambda value: "name" if isinstance(value, str) else "number"),
    ]
    scale: Positive = 1.0
    count: Annotated[int, Field(ge=1, le=MOST_POINTS)] = 10_000
    fill: Annotated[str, one_of(("volume", "surface"), "way to fill a solid")] = "volume"
    seed: Annotated[int, Field(ge=0)] = 0

    def build(self, folder: Path) -> Cloud:
        """folder: where the file lies"""
        radius = self.radius if isinstance(self.radius, str) else float(self.radius)
        if isinstance(self.cloud, str):
            path = folder / self.cloud
            return CloudOfFile(digest_of_file(path), radius, float(self.scale), path)
        assert not isinstance(radius, str), "checked: only files have attributes"
        fill: Literal["volume", "surface"] = "surface" if self.fill == "surface" else "volume"
        return CloudInSolid(self.cloud.build(), self.count, fill, self.seed, radius)


class NetDocument(Document):
    net: Annotated[
        Annotated[str, Tag("a file")]
        | Annotated[list[list[Triple]], Tag("rows")]
        | Annotated[NetSolidDocument, Tag("a solid")],
        Discriminator(_form),
    ]
    scale: Positive = 1.0
    rows: Annotated[int, Field(ge=LEAST, le=1000)] | None = None
    columns: Annotated[int, Field(ge=LEAST, le=1000)] | None = None
    closed: Annotated[str, one_of(CLOSED, "way to close a net")] = "none"

    def build(self, folder: Path) -> ControlNet:
        """folder: where the file lies"""
        if isinstance(self.net, str):
            path = folder / self.net
            return NetOfFile(digest_of_file(path), self.columns, CLOSED[self.closed], float(self.scale), path)
        if isinstance(self.net, list):
            rows = tuple(tuple(tuple(float(x) for x in point) for point in row) for row in self.net)
            return NetOfRows(rows, CLOSED[self.closed])
        given = self.net.model_dump(exclude_none=True, exclude={"solid"})
        return NetOfSolid.of(self.net.solid, given, self.rows, self.columns)


def points(source: Source) -> Iterator[tuple[Where, str]]:
    """A cloud or a net is told what it can be told, and its points are good: a check of `checks`' kind."""
    for kind in _BELONG:
        made_from = source.get("subject", kind)
        if isinstance(made_from, str | list | dict) and _form(made_from) in _BELONG[kind]:
            yield from _strangers(source, kind, _form(made_from))
            yield from _faults(source, kind, made_from)


def resampled(source: Source) -> Iterator[tuple[Where, str]]:
    """What is a surface says how it is resampled; points are not."""
    subject = source.get("subject")
    kind = next((kind for kind in _BELONG if isinstance(subject, dict) and kind in subject), None)
    resample = source.get("resample")
    if kind is None and isinstance(source.data, dict) and "resample" not in source.data:
        yield (), "resample is missing; it has no default. Add `resample: …`."
    elif kind is not None and resample not in (None, "off"):
        what = "points of a cloud have no edges" if kind == "cloud" else "the points of a net keep their rows"
        yield ("resample",), f"{what}, and are not resampled. Write resample: off, or leave it out."


def _strangers(source: Source, kind: str, made_from: str) -> Iterator[tuple[Where, str]]:
    every = {name for names in _BELONG[kind].values() for name in names}
    for name in sorted(every - set(_BELONG[kind][made_from])):
        if source.get("subject", name) is not None:
            owners = [form for form, names in _BELONG[kind].items() if name in names]
            yield (
                ("subject", name),
                f"{name} is for a {kind} of {' or '.join(owners)}; this is one of {made_from}. Leave it out.",
            )


def _faults(source: Source, kind: str, made_from: Any) -> Iterator[tuple[Where, str]]:
    """What is wrong with the points themselves. That a file is not there is told elsewhere."""
    where = ("subject", kind)
    try:
        if isinstance(made_from, str):
            path = source.path.parent / made_from
            if is_there(path):
                _require_good_file(source, kind, path)
        elif isinstance(made_from, list):
            yield from _uneven(made_from)
        elif kind == "cloud":
            yield from _unfillable(source, made_from)
    except MissingInputError:
        return  # told with the file
    except MeshError as error:
        yield where, str(error)


def _unfillable(source: Source, made_from: dict[str, Any]) -> Iterator[tuple[Where, str]]:
    """What a cloud in a solid cannot be: within what encloses nothing, or of radii that nobody knows."""
    fill, radius = source.get("subject", "fill"), source.get("subject", "radius")
    if made_from.get("solid") == "sheet" and fill in (None, "volume"):
        yield ("subject", "cloud"), "a sheet encloses no volume to fill. Write fill: surface."
    if isinstance(radius, str):
        yield ("subject", "radius"), f"points in a solid have no attribute {radius!r}; write a number."


def _require_good_file(source: Source, kind: str, path: Path) -> None:
    """Raises MeshError for a file that is no cloud or net."""
    if kind == "cloud":
        radius = source.get("subject", "radius")
        radii_of(read_points(path), radius if isinstance(radius, str) else 1.0, str(path))
        return
    columns = source.get("subject", "columns")
    known = isinstance(columns, int) and not isinstance(columns, bool) and columns >= LEAST
    grid = read_net(path, columns if known else None)
    Lattice(*grid.shape[:2])


def _uneven(rows: list[Any]) -> Iterator[tuple[Where, str]]:
    """Rows of a net that are too few or of different lengths; points are for the document to judge."""
    where = ("subject", "net")
    if not all(isinstance(row, list) for row in rows) or not rows:
        if not rows:
            yield where, "the net has no rows; a bicubic patch needs 4 × 4 points. Write them."
        return
    odd = next((k for k, row in enumerate(rows) if len(row) != len(rows[0])), None)
    if odd is not None:
        yield (
            (*where, odd),
            f"row {odd} has {len(rows[odd])} points and row 0 has {len(rows[0])}; all rows of a net are "
            "equally long. Add or remove points.",
        )
        return
    try:
        Lattice(len(rows), len(rows[0]))
    except MeshError as error:
        yield where, str(error)
