"""Write vertex animation textures: positions and normals of a moving mesh as pictures that game engines read.

renders/<shot>/vat/<shot>.glb             the mesh at the first frame; its second texture coordinates address
renders/<shot>/vat/<shot>.positions.exr   positions, half floats (floats where halves are too coarse)
renders/<shot>/vat/<shot>.normals.png     normals, 8 bits
renders/<shot>/vat/<shot>.json            what shaders need to know

A column is a vertex and a row a frame. Where there are more vertices than columns, the textures have several
blocks of rows, one below the other: vertex v is in column v mod width of block v // width. Frame f of a block
of F frames is row f, so shaders add f / height to the second coordinate.

    position = centre + extent · texel        normal = 2 · texel − 1
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from flowsculpt import UsageError
from flowsculpt.api.files import disk_errors
from flowsculpt.api.materials import Material
from flowsculpt.api.meshes import Floats
from flowsculpt.api.pictures import RenderedFrame, write_exr, write_still
from flowsculpt.pipeline.plugins.interchange.animated_gltf import Moving, write_animated_gltf
from flowsculpt.pipeline.plugins.interchange.drawn_mesh import DrawnMesh, KeyPoses
from flowsculpt.pipeline.plugins.interchange.one_mesh import even_step

LARGEST = 8192  # columns and rows of a texture that all three engines read

_STEPS = 128.0  # steps of positions in an edge: finer digits would be noise that does not compress

_COARSEST = 1.0 / 32.0  # rounding of halves, in edges, above which positions are floats

_HALF = 2.0**-12  # largest rounding of a half between -1 and 1


@dataclass(frozen=True, eq=False)
class Layout:
    """The places of vertices and frames in a texture."""

    vertices: int
    frames: int

    @property
    def blocks(self) -> int:
        """The number of blocks of rows."""
        return -(-self.vertices // LARGEST)

    @property
    def width(self) -> int:
        return -(-self.vertices // self.blocks)

    @property
    def height(self) -> int:
        return self.blocks * self.frames

    @classmethod
    def of(cls, drawn: DrawnMesh) -> Layout:
        """Return the layout of a mesh. Raises UsageError where no texture is large enough."""
        layout = cls(len(drawn.source), len(drawn.mesh.frames))
        if layout.height > LARGEST:
            most = LARGEST // layout.frames * LARGEST
            vertices = int(most * len(drawn.mesh.rest) / layout.vertices)
            remedy = f"use --vertices {vertices} or fewer frames" if vertices else "use fewer frames"
            raise UsageError(
                f"{drawn.mesh.name}: {layout.vertices} vertices (split at creases and seams) at "
                f"{layout.frames} frames take {layout.height} rows of {layout.width}, and engines read "
                f"textures up to {LARGEST} × {LARGEST}; {remedy}"
            )
        return layout

    def addresses(self) -> Floats:
        """Return where the texel of each vertex is at the first frame, (V, 2), to the right and down."""
        vertex = np.arange(self.vertices)
        column, row = vertex % self.width, vertex // self.width * self.frames
        return np.stack([(column + 0.5) / self.width, (row + 0.5) / self.height], axis=1)

    def rows_of(self, frame: int) -> slice:
        """The rows of a frame, counted from 0, one in each block."""
        return slice(frame, None, self.frames)

    def spread(self, values: np.ndarray) -> np.ndarray:
        """Return values (V, 3) of a frame as its rows (blocks, width, 3); what is left over is 0."""
        padded = np.zeros((self.blocks * self.width, 3), values.dtype)
        padded[: self.vertices] = values
        return padded.reshape(self.blocks, self.width, 3)


@dataclass(frozen=True, eq=False)
class VertexTextures:
    """The textures of a mesh.

    positions  float32 (H, W, 3), -1 to 1 over the bounds
    normals    uint8 (H, W, 3)
    is_round   True if the first frame follows the last
    """

    drawn: DrawnMesh
    layout: Layout
    positions: np.ndarray
    normals: np.ndarray
    centre: Floats
    extent: Floats
    precision: str
    rate: float
    is_round: bool = False

    @classmethod
    def of(
        cls, drawn: DrawnMesh, passed: Callable[[], None] = lambda: None, is_round: bool = False
    ) -> VertexTextures:
        """Fill the textures of a mesh. Raises UsageError as `even_step` and `Layout.of` do."""
        layout, numbers = Layout.of(drawn), drawn.mesh.frames
        rate = float(drawn.mesh.rate.fps) / even_step(numbers)
        low, high = drawn.bounds
        centre, extent = 0.5 * (low + high), np.maximum(0.5 * (high - low), 1e-9)
        edge = min(drawn.edge_at(n, drawn.mesh.points_at(n)) for n in numbers)
        step = edge / _STEPS
        shape = (layout.height, layout.width, 3)
        positions, normals = np.zeros(shape, np.float32), np.zeros(shape, np.uint8)
        for index, number in enumerate(numbers):
            points, vectors = drawn.frame(number)
            place = np.rint((points - centre) / step) * step / extent
            positions[layout.rows_of(index)] = layout.spread(np.clip(place, -1.0, 1.0))
            normals[layout.rows_of(index)] = layout.spread(np.rint(127.5 + 127.5 * vectors).astype(np.uint8))
            passed()
        precision = "half" if _HALF * extent.max() <= _COARSEST * edge else "float"
        return cls(drawn, layout, positions, normals, centre, extent, precision, rate, is_round)

    def facts(self, names: dict[str, str]) -> dict[str, Any]:
        """Return what shaders need to know, as JSON data; `names` are the files."""
        mesh = self.drawn.mesh
        first, last = mesh.points_at(mesh.frames[0]), mesh.points_at(mesh.frames[-1])
        return {
            "name": mesh.name,
            "files": names,
            "vertices": self.layout.vertices,
            "frames": self.layout.frames,
            "first_frame": mesh.frames[0],
            "rate": self.rate,
            "loops": self.layout.frames > 1 and (self.is_round or bool(np.array_equal(first, last))),
            "width": self.layout.width,
            "height": self.layout.height,
            "blocks": self.layout.blocks,
            "centre": self.centre.tolist(),
            "extent": self.extent.tolist(),
            "precision": self.precision,
            "axes": "y up, right-handed, as glTF",
        }

    def write_positions(self, path: Path) -> None:
        """Write the positions as an EXR. Raises MachineError where the disk refuses."""
        frame = RenderedFrame({"beauty": self.positions})
        write_exr(path, frame, {}, {"beauty": self.precision}, compression="piz")

    def write_normals(self, path: Path) -> None:
        """Write the normals as a PNG. Raises MachineError where the disk refuses."""
        write_still(path, self.normals)

    def write_mesh(self, path: Path, look: Material) -> None:
        """Write the mesh at the first frame. Raises MachineError where the disk refuses."""
        mesh = self.drawn.mesh
        still = replace(self.drawn, mesh=replace(mesh, frames=mesh.frames[:1]))
        part = Moving(mesh.name, KeyPoses.of(still), look, self.layout.addresses())
        write_animated_gltf(path, mesh.name, [part], plain=True)

    def write_facts(self, path: Path, names: dict[str, str]) -> None:
        """Write what shaders need to know. Raises MachineError where the disk refuses."""
        with disk_errors(path):
            path.write_text(json.dumps(self.facts(names), indent=2) + "\n", encoding="utf-8")
