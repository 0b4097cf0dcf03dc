"""Read meshes with their polygons, from files of the formats of the core and of plug-ins, and repair them.

trimesh cuts faces of more than four sides into fans, which is wrong for concave ones, and drops groups.

Repair makes a sound surface of the faces of a file: finite, oriented and manifold. The steps: faces that name
a vertex twice are cut in two; duplicate faces are dropped; at edges with more than two faces pairs stay
joined and the others are separated; faces are wound alike; and each fan of faces around a vertex gets a
vertex of its own.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np

from flowsculpt.pipeline.arrays import AnyArray
from flowsculpt.pipeline.errors import FlowsculptError, MachineError, MeshError, reason_of
from flowsculpt.pipeline.mesh.face_soup import (
    FaceSoup,
    MergedSurface,
    cut_repeats,
    find_duplicates,
    merge_coincident,
)
from flowsculpt.pipeline.mesh.kernels.face_measures import may_face_inwards
from flowsculpt.pipeline.mesh.mesh_formats import (
    FileSurface,
    ModelMaterials,
    MovingSurface,
    Paint,
    PaintReader,
    ScenePart,
    SourceFiles,
    SurfaceReader,
    suffix_of,
)
from flowsculpt.pipeline.mesh.meshes import PolygonMesh, TriangleMesh, edge_keys
from flowsculpt.pipeline.mesh.validation import Soundness, validate
from flowsculpt.pipeline.mesh.winding import Winding, detached_corners, find_winding, link_sides
from flowsculpt.pipeline.plugin import named, plugins
from flowsculpt.render.base.input_files import InputFile, other_content
from flowsculpt.render.base.kept_digests import KeptDigests


def mesh_suffixes() -> tuple[str, ...]:
    """Return the suffixes of readable mesh files."""
    return tuple(plugins().readers("surface"))


def _reader_at(place: str | None, kind: type[T]) -> T | None:
    """Return the reader at a place, "module:name". Raises MachineError where it is not of the kind."""
    found = named(place) if place else None
    if not isinstance(found, kind | None):
        raise MachineError(f"{place}, which a plug-in names as a reader, is not a {kind.__name__}")
    return found


def read_mesh(path: str | Path) -> TriangleMesh:
    """Return the surface of a file in triangles: PLY, OBJ, STL, OFF, GLB, DAE, 3MF; with extras FBX and USD.

    Scenes are joined, coincident vertices merged, polygons cut into triangles (P23), and what is not sound is
    repaired. Keeps the creases of the file, and no attributes: see `TextureCoordinates` for those.

    Raises MissingInputError where there is no such file, MeshError where it cannot be read or repaired, and
    MachineError without the package that reads its format.
    """
    return read_polygons(path).triangulated()


def read_polygons(path: str | Path) -> PolygonMesh:
    """Read a surface as it is, with its polygons, repaired where needed.

    Raises the errors of `ModelFile.surface`.
    """
    return ModelFile(Path(path)).surface().mesh


@dataclass(frozen=True)
class ImportedSurface:
    """A surface read from a file.

    mesh      sound: finite, oriented and manifold; with the creases of the file
    repairs   one line for each kind of repair, with the count and the coordinates of the first
    format    suffix of the file in capitals: `OBJ`
    vertices  number of vertices in the file; of merged ones where its faces share none, as in an STL
    faces     number of faces in the file
    notes     lines about what was not read as other programs show it
    unit      length of a unit of its coordinates, metres; None where the file does not say it
    """

    mesh: PolygonMesh
    repairs: tuple[str, ...]
    format: str
    vertices: int
    faces: int
    notes: tuple[str, ...] = ()
    unit: float | None = None

    @property
    def warnings(self) -> tuple[str, ...]:
        """Lines to tell the user about a model: what was repaired, and the notes."""
        repaired = (f"model repaired: {line}" for line in self.repairs)
        return (*repaired, *(f"model: {line}" for line in self.notes))


@dataclass(frozen=True)
class ModelFile:
    """A file that holds a model, and what the readers of its suffix read of it.

    part  of a scene whose format names parts

    Each method that reads it raises MissingInputError where the file, or one that it names, is not there;
    MeshError where it cannot be read; and MachineError without the package that reads its format.
    """

    path: Path
    part: ScenePart | None = None

    @property
    def reader(self) -> SurfaceReader | None:
        """The reader of its surface; None where nothing reads it."""
        return _reader_at(plugins().readers("surface").get(suffix_of(self.path)), SurfaceReader)

    @property
    def names_parts(self) -> bool:
        """True if parts of scenes in its format have names, as prims of USD have."""
        return self.reader is not None and self.reader.read_part is not None

    def surface(self, repair: bool = True) -> ImportedSurface:
        """Read the surface: scenes are joined, polygons kept, coincident vertices merged, faults repaired.

        Merging joins the loose triangles of an STL and the seams of textured models into one surface; faces
        with fewer than three corners left are dropped, and so are unused vertices. Creases are the edges that
        an OBJ tags as such, and those between faces of different objects, groups, smoothing groups or
        materials (P31); those of other formats as their readers say.

        Raises MeshError also where it is not a finite, oriented manifold: without `repair` for any such
        fault, with it for those that cannot be repaired.
        """
        path, reader = self.path, self.reader
        readers = {} if reader is None else {suffix_of(path): reader.reads(self.part)}
        loaded = self.read_by(readers, "a mesh format", mesh_suffixes())
        if len(loaded.corners) == 0:
            _require_own_content(path)
            rest = "".join(f"; {note}" for note in loaded.notes)
            raise MeshError(f"{path}: it has no faces; a surface needs at least one triangle{rest}")
        _require_cuttable(path, loaded)
        try:
            mesh, repairs = repair_surface(loaded, repair)
        except MeshError as error:
            raise MeshError(f"{path}: {error}") from None
        suffix = path.suffix.lstrip(".").upper()
        vertices = len(loaded.points) if loaded.shares_vertices else len(mesh.vertices)
        return ImportedSurface(
            mesh, repairs, suffix, vertices, len(loaded.offsets) - 1, loaded.notes, loaded.unit
        )

    def files(self, keeps_digest: bool = False) -> SourceFiles:
        """Return the files of the model, and their digests.

        keeps_digest  True for one of many files: it is read again only once it has changed (`KeptDigests`)
        """
        reader = self.reader
        if reader is None or reader.files is None:
            if keeps_digest:
                digest = KeptDigests.of(self.path.parent).digest(self.path.name)
                return SourceFiles(digest, ((self.path, digest),))
            return _own_file(self.path, None if reader is None else reader.misread)
        return self.read_by({suffix_of(self.path): reader.files}, "a mesh format")

    def up(self) -> str:
        """Return the axis, y or z, that points up: what the file states, or what is usual in its format."""
        if self.reader is None:
            return "y"
        return (self.files().up if self.reader.states_up else None) or self.reader.usual_up

    def read_by(self, readers: Mapping[str, Callable[[Path], T]], kind: str, known: Sequence[str] = ()) -> T:
        """Return what the reader of its suffix returns.

        kind   what the file is to be, for messages: `a file of points`
        known  suffixes for the message, where there are more than `readers` has

        Raises MeshError also for another suffix, and BadInputError for a file that is too large.
        """
        path, suffix = self.path, suffix_of(self.path)
        size = InputFile(path).size()
        if suffix not in readers:
            fact = f"{path}: {path.suffix or 'no suffix'} is not {kind}"
            if needed := plugins().lacking(f".{suffix}"):
                raise MeshError(f"{fact}. {needed}")
            raise MeshError(f"{fact}; use one of {', '.join(known or readers)}")
        if not size:
            raise MeshError(f"{path}: the file is empty. Copy or export it again.")
        try:
            with np.errstate(all="ignore"):  # numbers that are not finite are reported with their position
                return readers[suffix](path)
        except Exception as error:  # readers raise whatever their parsers do
            if isinstance(error, FlowsculptError) and not isinstance(error, MeshError):
                raise
            _require_own_content(path)
            if isinstance(error, MeshError):
                raise MeshError(f"{path}: {error}") from None
            reason = f"cannot be read as {suffix.upper()} ({reason_of(error)})"
            raise MeshError(f"{path}: {reason}. Copy or export it again.") from error

    def motion(self, points: Path | None = None) -> MovingSurface:
        """Open the moving surface of the file.

        points  a file with the points of the model's vertices over time, such as PC2; None where they are in
                the model's own file
        """
        readers = plugins().readers("motion")
        moving, other = (self, self.part) if points is None else (ModelFile(points), self.path)
        suffix = suffix_of(moving.path)
        known = {suffix: lambda path: named(readers[suffix])(path, other)} if suffix in readers else {}
        return moving.read_by(known, "a format of moving surfaces", tuple(readers))

    def materials(self) -> ModelMaterials:
        """Read the materials of the model."""
        return self._painted(lambda reader: reader.materials)

    def paint(self) -> Paint:
        """Read the paint on its faces."""
        return self._painted(lambda reader: reader.paint)

    def paint_files(self) -> Mapping[Path, str]:
        """Return the files that paint is read from besides those of the surface, and their SHA-256."""
        return self._painted(lambda reader: reader.files)

    def _painted(self, read: Callable[[PaintReader], Callable[[Path], T]]) -> T:
        readers = plugins().readers("paint")
        reader = _reader_at(readers.get(suffix_of(self.path)), PaintReader)
        if reader is None:
            known = ", ".join(readers) or "files by plug-ins alone"
            fact = f"paint is read from {known}, not from {self.path.suffix}"
            raise MeshError(f"{self.path}: {fact}. Write paint: off.")
        if self.part is not None and reader.of_part is not None:
            reader = reader.of_part(self.part)
        return self.read_by({suffix_of(self.path): read(reader)}, "a mesh format")


_FEW_CORNERS, _MOST_WORK = 64, 1.2e9
"""Cutting a face of n corners takes n³ steps; those of faces with few corners are not counted."""


def _require_cuttable(path: Path, surface: FileSurface) -> None:
    """Raise MeshError where cutting the faces into triangles would take more than seconds."""
    sides = np.diff(surface.offsets)
    if (sides[sides > _FEW_CORNERS].astype(np.float64) ** 3).sum() > _MOST_WORK:
        face = int(np.argmax(sides))
        raise MeshError(
            f"{path}: face {face + (surface.base or 0)} has {sides[face]} corners, too many to be cut into "
            "triangles here. Triangulate the model in the program that made it."
        )


def _own_file(path: Path, misread: re.Pattern[bytes] | None) -> SourceFiles:
    """Return the files of a model that is read from one."""
    digest = InputFile(path).digest()
    reader = []
    if misread is not None:
        with InputFile(path).open() as (file, size):
            reader = ["text reader 2"] * bool(misread.search(file.read(min(size, 1 << 14))))
    return SourceFiles.of([(path, digest)], readers=reader)


def _require_own_content(path: Path) -> None:
    """Raise MeshError where the content of a file is that of files with other suffixes."""
    if other := other_content(path):
        raise MeshError(f"{path}: it is {other}, not a model in {path.suffix}. Download or export it again.")


_DANGLING = 0.01
"""Area of a single face at the edge of others over that of the surface: up to this it is dropped."""


class RepairedSurface(NamedTuple):
    """A sound surface; `repairs` has one line for each kind of change, with count and first coordinates."""

    mesh: PolygonMesh
    repairs: tuple[str, ...] = ()


def repair_surface(surface: FileSurface, repair: bool = True) -> RepairedSurface:
    """Return the sound surface of a file's polygons, with the creases of the file.

    A surface that is sound once its coincident vertices are merged, and not inside out, is returned as it is.

    Raises MeshError where nothing sound can be made of it, and without `repair` wherever it is not sound.
    """
    merged = merge_coincident(surface)
    soup, changes = merged.soup, RepairLog(surface)
    _tell_merging(merged, changes)
    faults = RepairLog(surface)
    _require_faces(soup)
    mesh, origin = soup.to_mesh()
    found = _soundness(mesh)
    problem = found.problem
    if problem is not None or (repair and _is_inside_out(soup, mesh, found)):
        soup = _cut_and_drop(soup, faults)
        mesh, soup, origin = _separate(soup, faults)
        problem = _soundness(mesh).problem
    if faults.lines and not repair:
        raise MeshError(f"{'; '.join(faults.faults)}. Write repair: on, or repair the model.")
    if problem is not None:
        raise MeshError(f"it cannot be repaired: {problem}")
    creases = [_between_groups(mesh, surface.groups[soup.faces]), _tagged(mesh, origin, merged, surface)]
    return RepairedSurface(mesh.with_creases(np.concatenate(creases)), (*changes.lines, *faults.lines))


@dataclass
class RepairLog:
    """Collects what is wrong with a file's surface, and what was done about it."""

    surface: FileSurface
    faults: list[str] = field(default_factory=list)
    lines: list[str] = field(default_factory=list)

    def add(self, vertices: AnyArray, one: str, many: str, done: str) -> None:
        """Add a kind of change, if it has places: `vertices` of the file. `one` and `many` say the fault."""
        if not len(vertices):
            return
        count, first = len(vertices), int(vertices[0])
        at = self._place(self.surface.points[first])
        number = "" if self.surface.base is None else f", vertex {first + self.surface.base}"
        place = f"at ({at}){number}" if count == 1 else f"the first at ({at}){number}"
        fault = f"1 {one}, {place}" if count == 1 else f"{count} {many}, {place}"
        self.faults.append(fault)
        self.lines.append(f"{fault}: {done}")

    def _place(self, point: AnyArray) -> str:
        """Return coordinates to six digits of the largest of all, so that noise near 0 reads as 0."""
        size = float(np.nanmax(np.abs(self.surface.points[self.surface.corners])))
        decimals = 5 - math.floor(math.log10(size)) if size > 0 else 0
        return ", ".join(f"{round(float(value), decimals) + 0.0:.9g}" for value in point)


def _tell_merging(merged: MergedSurface, changes: RepairLog) -> None:
    surface = changes.surface
    if surface.shares_vertices:
        double = np.flatnonzero(merged.joined != np.arange(len(merged.joined)))
        changes.add(double, "vertex lies on another", "vertices lie on others", "merged")
        changes.add(merged.unused, "vertex belongs to no face", "vertices belong to no face", "dropped")
    first = surface.corners[np.minimum(surface.offsets[merged.collapsed], len(surface.corners) - 1)]
    one, many = "face has fewer than three different corners", "faces have fewer than three different corners"
    changes.add(first, one, many, "dropped")


def _cut_and_drop(soup: FaceSoup, faults: RepairLog) -> FaceSoup:
    """Cut faces that name a vertex twice; drop faces that stand twice or back to back."""
    soup, cut = cut_repeats(soup)
    faults.add(
        soup.vertices[cut], "face names a vertex twice", "faces name a vertex twice", "cut in two there"
    )
    _require_faces(soup)
    twice, doubled, inner = find_duplicates(soup)
    kinds = [
        (twice, "face is in the file twice", "faces are in the file twice", "one of each kept"),
        (
            doubled,
            "face covers another that faces the other way",
            "faces cover others that face the other way",
            "one of each pair kept",
        ),
        (inner, "face is part of a wall inside", "faces are part of walls inside", "dropped"),
    ]
    for flags, one, many, done in kinds:
        faults.add(_first_vertices(soup, flags), one, many, done)
    return soup.keep_faces(~(twice | doubled | inner))


def _require_faces(soup: FaceSoup) -> None:
    if not len(soup):
        raise MeshError("all its faces are degenerate: none has three different corners. Export it again.")


def _first_vertices(soup: FaceSoup, faces: AnyArray) -> AnyArray:
    """Return for each flagged face the file's number of its first vertex."""
    return soup.vertices[soup.corners[soup.offsets[:-1][faces]]]


def _separate(soup: FaceSoup, faults: RepairLog) -> tuple[PolygonMesh, FaceSoup, AnyArray]:
    """Return the mesh in which every edge has one or two faces and every vertex one fan.

    Also returns its faces as a soup, and the vertex of the soup of each vertex of the mesh.
    """
    soup, link, crowded = _without_dangling(soup, faults)
    winding = find_winding(soup, link)
    _tell_edges(soup, crowded, faults)
    _tell_winding(soup, winding, faults)
    open_sides = crowded | winding.cut
    at_edge = np.zeros(len(soup.points), bool)
    at_edge[soup.corners[open_sides]] = at_edge[soup.heads[open_sides]] = True
    soup, link = _reverse(soup, np.where(winding.cut, -1, link), winding.reversed_faces)
    labels = detached_corners(soup, link)
    _tell_fans(soup, labels, at_edge, faults)
    mesh, origin = soup.to_mesh(labels)
    return mesh, soup, origin


def _without_dangling(soup: FaceSoup, faults: RepairLog) -> tuple[FaceSoup, AnyArray, AnyArray]:
    """Link sides and drop small single faces at the edge of others; return soup, links and crowded sides."""
    link, crowded = link_sides(soup)
    owners = soup.owners
    linked, touching = np.zeros(len(soup), bool), np.zeros(len(soup), bool)
    linked[owners[link >= 0]] = True
    touching[owners[crowded]] = True
    dangling = touching & ~linked & (soup.areas <= _DANGLING * soup.areas.sum())
    if not dangling.any() or dangling.all():
        return soup, link, crowded
    one, many = "face hangs at an edge of two others", "faces hang at edges of two others"
    faults.add(_first_vertices(soup, dangling), one, many, "dropped")
    rest = soup.keep_faces(~dangling)
    return rest, *link_sides(rest)


def _tell_edges(soup: FaceSoup, crowded: AnyArray, faults: RepairLog) -> None:
    low, high = np.minimum(soup.corners, soup.heads), np.maximum(soup.corners, soup.heads)
    edges = np.unique((low * len(soup.points) + high)[crowded]) // len(soup.points)
    one, many = "edge has more than two faces", "edges have more than two faces"
    done = "two stay joined" if len(edges) == 1 else "two of each stay joined"
    faults.add(soup.vertices[edges], one, many, f"{done}, the others are separated")


def _tell_winding(soup: FaceSoup, winding: Winding, faults: RepairLog) -> None:
    against, inwards, cut = winding
    one, many = "edge closes a one-sided surface", "edges close one-sided surfaces"
    sides = np.flatnonzero(cut & (np.cumsum(cut) % 2 == 1))
    faults.add(soup.vertices[soup.corners[sides]], one, many, "cut open there")
    one, many = "face is wound against its neighbours", "faces are wound against their neighbours"
    faults.add(_first_vertices(soup, against), one, many, "reversed")
    one, many = "face of a closed surface faces inwards", "faces of closed surfaces face inwards"
    faults.add(_first_vertices(soup, inwards), one, many, "reversed")


def _reverse(soup: FaceSoup, link: AnyArray, faces: AnyArray) -> tuple[FaceSoup, AnyArray]:
    """Return the soup and its links with the flagged faces reversed; each keeps its first corner."""
    starts, sides = soup.offsets[:-1][soup.owners], soup.sides[soup.owners]
    step = np.arange(len(link)) - starts
    turned = faces[soup.owners]
    corners = soup.corners[np.where(turned, starts + -step % sides, starts + step)]
    moved = np.where(turned, starts + -(step + 1) % sides, starts + step)  # the place of each side
    links = np.empty_like(link)
    links[moved] = np.where(link < 0, -1, moved[link])
    return replace(soup, corners=corners), links


def _tell_fans(soup: FaceSoup, labels: AnyArray, crowded: AnyArray, faults: RepairLog) -> None:
    """Count vertices with several fans that do not lie at crowded or cut edges; `crowded` flags those."""
    _, first = np.unique(labels, return_index=True)
    fans = np.bincount(soup.corners[first], minlength=len(soup.points))
    split = np.flatnonzero((fans > 1) & ~crowded)
    one, many = "vertex joins two parts by a point only", "vertices join two parts by a point only"
    faults.add(soup.vertices[split], one, many, "split")


def _soundness(mesh: PolygonMesh) -> Soundness:
    """Return the result of `validate`; kernels are quicker where all faces are triangles."""
    return validate(mesh if mesh.sides.max() > 3 else mesh.triangulated())


def _is_inside_out(soup: FaceSoup, mesh: PolygonMesh, found: Soundness) -> bool:
    """Return whether a sound surface has closed parts that face inwards and should not.

    mesh  of the soup, vertex by vertex
    """
    if found.twins is not None:
        faces = mesh.corners.reshape(-1, 3)
        if not may_face_inwards(soup.centred_points, faces, found.twins):
            return False
    return bool(find_winding(soup, link_sides(soup).link).inwards.any())


def _between_groups(mesh: PolygonMesh, groups: AnyArray) -> AnyArray:
    """Return the edges (K, 2) whose two faces belong to different groups."""
    if not len(groups) or groups.min() == groups.max():
        return np.empty((0, 2), np.int64)
    twin, mine = mesh.twins, groups[mesh.owners]
    parting = (twin >= 0) & (mine != mine[twin])
    return np.column_stack([mesh.corners[parting], mesh.heads[parting]])


def _tagged(mesh: PolygonMesh, origin: AnyArray, merged: MergedSurface, surface: FileSurface) -> AnyArray:
    """Return the edges (K, 2) that the file tags as creases; it ignores tags between unconnected vertices."""
    tagged = surface.tagged
    inside = tagged[((tagged >= 0) & (tagged < len(surface.points))).all(axis=1)]
    if not len(inside):
        return np.empty((0, 2), np.int64)
    edges = mesh.edges
    ends = merged.soup.vertices[origin][edges]
    return edges[np.isin(edge_keys(ends), edge_keys(merged.joined[inside]))]


T = TypeVar("T")
