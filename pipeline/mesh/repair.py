"""Repair: from the faces of a file to a sound surface, and what was changed on the way.

A surface is sound if it is finite, oriented and manifold. The steps: faces that name a vertex twice are cut
in two; duplicate faces are dropped; at edges with more than two faces pairs stay joined and the others are
separated; faces are wound alike; and each fan of faces around a vertex gets a vertex of its own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.errors import MeshError
from pipeline.mesh.face_soup import FaceSoup, MergedSurface, cut_repeats, find_duplicates, merge_coincident
from pipeline.mesh.file_surface import FileSurface
from pipeline.mesh.polygon_mesh import PolygonMesh
from pipeline.mesh.triangle_mesh import edge_keys
from pipeline.mesh.validation import twin_corners, validate
from pipeline.mesh.winding import Winding, detached_corners, find_winding, link_sides

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
    problem = _problem(mesh)
    if problem is not None or (repair and _is_inside_out(soup)):
        soup = _cut_and_drop(soup, faults)
        mesh, soup, origin = _separate(soup, faults)
        problem = _problem(mesh)
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
    soup, link = _reversed(soup, np.where(winding.cut, -1, link), winding.reversed_faces)
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


def _reversed(soup: FaceSoup, link: AnyArray, faces: AnyArray) -> tuple[FaceSoup, AnyArray]:
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


def _problem(mesh: PolygonMesh) -> str | None:
    """Return the first fault of a mesh, or None; kernels are quicker where all faces are triangles."""
    return validate(mesh if mesh.sides.max() > 3 else mesh.triangulated()).problem


def _is_inside_out(soup: FaceSoup) -> bool:
    return bool(find_winding(soup, link_sides(soup).link).inwards.any())


def _between_groups(mesh: PolygonMesh, groups: AnyArray) -> AnyArray:
    """Return the edges (K, 2) whose two faces belong to different groups."""
    if not len(groups) or groups.min() == groups.max():
        return np.empty((0, 2), np.int64)
    twin, mine = twin_corners(mesh), groups[mesh.owners]
    parting = (twin >= 0) & (mine != mine[twin])
    return np.column_stack([mesh.corners[parting], mesh.heads[parting]])


def _tagged(mesh: PolygonMesh, origin: AnyArray, merged: MergedSurface, surface: FileSurface) -> AnyArray:
    """Return the edges (K, 2) that the file tags as creases; tags on what is no edge are ignored."""
    tagged = surface.tagged
    inside = tagged[((tagged >= 0) & (tagged < len(surface.points))).all(axis=1)]
    if not len(inside):
        return np.empty((0, 2), np.int64)
    edges = mesh.edges
    ends = merged.soup.vertices[origin][edges]
    return edges[np.isin(edge_keys(ends), edge_keys(merged.joined[inside]))]
