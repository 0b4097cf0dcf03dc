"""Clouds and nets in a shot file: their settings, and what may be wrong with them."""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, TypeGuard

from pydantic import Field

from flowsculpt import MeshError, MissingInputError
from flowsculpt.api import PointsKind, plural, quote
from flowsculpt.api.files import InputFile
from flowsculpt.api.meshes import Lattice
from flowsculpt.api.shots import ByForm, Document, Positive, SolidDocument, Triple, one_of
from flowsculpt.pipeline.plugins.points.clouds import MOST_POINTS, Cloud, CloudInSolid, CloudOfFile, radii_of
from flowsculpt.pipeline.plugins.points.nets import NETS, ControlNet, NetOfFile, NetOfRows, NetOfSolid
from flowsculpt.pipeline.plugins.points.point_files import read_net, read_points

Where = tuple[Any, ...]
"""The path to a value: names of mappings and indices of lists, from the top."""


def _foreign_settings(
    given: Mapping[str, Any], owners: Mapping[str, str], kind: str, made_from: str
) -> Iterator[tuple[Where, str]]:
    """Yield the settings of a subject of points that are for others of its kind.

    owners     what subjects that have a setting are made from, by its name
    made_from  what this one is made from
    """
    for name, owner in owners.items():
        if given.get(name) is not None:
            fact = f"{name} is for a {kind} of {owner}; this is one of {made_from}"
            yield (name,), f"{fact}. Leave it out."


_NUMBER = re.compile(r"\s*[-+]?\.?\d")
"""The beginning of text that is meant as a number."""


def _is_attribute(value: Any) -> TypeGuard[str]:
    return isinstance(value, str) and not _NUMBER.match(value)


class CloudDocument(PointsKind):
    """Points that are drawn as spheres."""

    not_resampled = "points of a cloud have no edges"

    cloud: Annotated[str | SolidDocument, ByForm(lambda value: isinstance(value, dict))] = Field(
        description="points that are drawn as spheres: a file of them, or a solid that they fill"
    )
    radius: Annotated[Positive | str, ByForm(_is_attribute)] = Field(
        description="of the spheres, or the name of an attribute of the file (units)"
    )
    scale: Positive = Field(1.0, description="factor on the coordinates of a file")
    count: Annotated[int, Field(ge=1, le=MOST_POINTS)] = Field(10_000, description="points in a solid")
    fill: Annotated[str, one_of(("volume", "surface"), "way to fill a solid")] = Field(
        "volume", description="the inside of the solid, or its surface"
    )
    seed: Annotated[int, Field(ge=0)] = Field(0, description="another one scatters the points differently")

    def build(self, folder: Path) -> Cloud:
        radius = self.radius if isinstance(self.radius, str) else float(self.radius)
        if isinstance(self.cloud, str):
            path = folder / self.cloud
            return CloudOfFile(InputFile(path).digest(), radius, float(self.scale), path)
        assert not isinstance(radius, str), "checked: only files have attributes"
        fill: Literal["volume", "surface"] = "surface" if self.fill == "surface" else "volume"
        return CloudInSolid(self.cloud.build(), self.count, fill, self.seed, radius)

    @classmethod
    def faults(cls, given: Mapping[str, Any], folder: Path) -> Iterator[tuple[Where, str]]:
        written, radius = given.get("cloud"), given.get("radius")
        if isinstance(written, str):
            owners = dict.fromkeys(("count", "fill", "seed"), "a solid")
            yield from _foreign_settings(given, owners, "cloud", "a file")
            yield from _faults_of_cloud(folder / written, radius if _is_attribute(radius) else 1.0)
        elif isinstance(written, dict):
            yield from _foreign_settings(given, {"scale": "a file"}, "cloud", "a solid")
            yield from SolidDocument.faults(("cloud",), written)
            if written.get("solid") == "sheet" and given.get("fill") in (None, "volume"):
                yield ("cloud",), "a sheet encloses no volume to fill. Write fill: surface."
            if _is_attribute(radius):
                fact = f"points in a solid have no attribute {quote(radius)}"
                yield ("radius",), f"{fact}; write a number."


def _faults_of_cloud(path: Path, radius: float | str) -> Iterator[tuple[Where, str]]:
    try:
        if InputFile(path).is_there():
            radii_of(read_points(path), radius, str(path))
    except MissingInputError:
        return  # is reported as such
    except MeshError as error:
        yield ("cloud",), str(error)


CLOSED = {"none": (False, False), "rows": (True, False), "columns": (False, True), "both": (True, True)}
"""Ends of a net that are joined: the last row to the first, the last column to the first."""


class NetSolidDocument(Document):
    solid: Annotated[str, one_of(NETS, "net")] = Field(description="its name")
    size: list[Positive] | None = Field(None, description="its sides (units)", min_length=2, max_length=2)
    radius: Positive | None = Field(None, description="of a tube, or to the middle of a torus's tube (units)")
    length: Positive | None = Field(None, description="from end to end (units)")
    tube_radius: Positive | None = Field(None, description="of the tube of a torus; below its radius (units)")


class NetDocument(PointsKind):
    """Control points of a smooth surface."""

    is_net = True
    not_resampled = "the points of a net keep their rows"
    not_copied = "a net is one grid of points and has no copies. Write several subjects."

    net: Annotated[
        str | list[list[Triple]] | NetSolidDocument,
        ByForm(lambda value: 2 if isinstance(value, dict) else int(isinstance(value, list))),
    ] = Field(description="control points of a smooth surface: a file, rows of points, or a solid")
    scale: Positive = Field(1.0, description="factor on the coordinates of a file")
    rows: Annotated[int, Field(ge=Lattice.least, le=1000)] | None = Field(
        None, description="number of rows, of a solid"
    )
    columns: Annotated[int, Field(ge=Lattice.least, le=1000)] | None = Field(
        None, description="points in a row, of a file or a solid"
    )
    closed: Annotated[str, one_of(CLOSED, "way to close a net")] = Field("none", description="joined ends")

    def build(self, folder: Path) -> ControlNet:
        if isinstance(self.net, str):
            path = folder / self.net
            return NetOfFile(
                InputFile(path).digest(), self.columns, CLOSED[self.closed], float(self.scale), path
            )
        if isinstance(self.net, list):
            rows = tuple(tuple(tuple(float(x) for x in point) for point in row) for row in self.net)
            return NetOfRows(rows, CLOSED[self.closed])
        measures = self.net.model_dump(exclude_none=True, exclude={"solid"})
        return NetOfSolid.of(self.net.solid, measures, self.rows, self.columns)

    @classmethod
    def faults(cls, given: Mapping[str, Any], folder: Path) -> Iterator[tuple[Where, str]]:
        written = given.get("net")
        if isinstance(written, dict):
            yield from _foreign_settings(given, _OWNERS_BESIDE["a solid"], "net", "a solid")
            yield from SolidDocument.faults(
                ("net",), written, NETS, lambda *named: NetOfSolid.of(*named).build()
            )
        elif isinstance(written, list):
            yield from _foreign_settings(given, _OWNERS_BESIDE["rows"], "net", "rows")
            yield from _faults_of_rows(written)
        elif isinstance(written, str):
            yield from _foreign_settings(given, _OWNERS_BESIDE["a file"], "net", "a file")
            columns = given.get("columns")
            is_known = isinstance(columns, int) and not isinstance(columns, bool) and columns >= Lattice.least
            yield from _faults_of_net(folder / written, columns if is_known else None)


_OWNERS_BESIDE = {
    "a file": {"rows": "a solid"},
    "rows": {"columns": "a file or a solid", "rows": "a solid", "scale": "a file"},
    "a solid": {"closed": "a file or rows", "scale": "a file"},
}
"""Settings that a net does not have, by what it is made from, and what nets that have them are made from."""


def _faults_of_net(path: Path, columns: int | None) -> Iterator[tuple[Where, str]]:
    try:
        if InputFile(path).is_there():
            Lattice(*read_net(path, columns).shape[:2])
    except MissingInputError:
        return  # is reported as such
    except MeshError as error:
        yield ("net",), str(error)


def _faults_of_rows(rows: list[Any]) -> Iterator[tuple[Where, str]]:
    """Check that a net has enough rows, all of one length; the document checks the points."""
    if not rows:
        yield ("net",), "the net has no rows; a bicubic patch needs 4 × 4 points. Write them."
    if not rows or not all(isinstance(row, list) for row in rows):
        return
    odd = next((k for k, row in enumerate(rows) if len(row) != len(rows[0])), None)
    if odd is not None:
        yield (
            ("net", odd),
            f"row {odd} has {plural(len(rows[odd]), 'point')} and row 0 has {len(rows[0])}; all rows of a "
            "net are equally long. Add or remove points.",
        )
        return
    try:
        Lattice(len(rows), len(rows[0]))
    except MeshError as error:
        yield ("net",), str(error)
