"""Write rigid copies as one glTF file: nodes that share a mesh, each with its places and turns."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import numpy as np

from flowsculpt.api import plural
from flowsculpt.api.materials import Material
from flowsculpt.api.meshes import Floats
from flowsculpt.pipeline.plugins.interchange.animation_export import AnimationExport
from flowsculpt.pipeline.plugins.interchange.copy_instances import Instances
from flowsculpt.pipeline.plugins.interchange.drawn_mesh import DrawnMesh
from flowsculpt.pipeline.plugins.interchange.gltf_content import FLOAT, GltfContent
from flowsculpt.pipeline.plugins.interchange.one_mesh import OneMesh
from flowsculpt.pipeline.plugins.interchange.refining import Began


class _CopyNodes(GltfContent):
    """The content of a file, as copies are added."""

    def add(self, copies: Instances, look: Material) -> None:
        """Add the shape, and a node for each copy with its animation."""
        name, numbers = copies.mesh.name, copies.mesh.frames
        meshes = self._meshes(copies, look)
        placements = [copies.placements(number) for number in numbers]
        turns = _in_order(np.stack([quaternions(each.rotations) for each in placements]))
        places = np.stack([each.origins for each in placements])
        times = self.times(copies.mesh, np.array(numbers))
        when = self.accessor(self.raw(times), times, "SCALAR", FLOAT, bounded=True)
        for k, size in enumerate(placements[0].sizes.tolist()):
            node = {
                "name": f"{name}.{k + 1}",
                "mesh": meshes[k],
                "translation": places[0, k].tolist(),
                "rotation": turns[0, k].tolist(),
                "scale": [size] * 3,
            }
            at = self.append("nodes", node)
            for path, kind, values in (("translation", "VEC3", places), ("rotation", "VEC4", turns)):
                rows = values[:, k].astype("<f4")
                self.animate(at, path, when, self.accessor(self.raw(rows), rows, kind, FLOAT))

    def _meshes(self, copies: Instances, look: Material) -> list[int]:
        """Add the shape once for each colour of copies; return the number (N,) of the mesh of each copy."""
        drawn = DrawnMesh.of(copies.shape)
        points, normals = drawn.frame(copies.shape.frames[0])
        attributes = {
            "POSITION": self.floats(points, "VEC3", bounded=True),
            "NORMAL": self.floats(normals, "VEC3"),
        }
        if drawn.texture is not None:
            attributes["TEXCOORD_0"] = self.floats(drawn.texture * (1.0, -1.0) + (0.0, 1.0), "VEC2")
        if drawn.colours is not None:
            attributes["COLOR_0"] = self.colours(drawn.colours)
        primitives = self.primitives(attributes, drawn.faces, drawn.materials, look, drawn.is_closed)
        count = len(copies.placements(copies.mesh.frames[0]))
        name = copies.mesh.name
        if copies.colours is None:
            return [self.append("meshes", {"name": name, "primitives": primitives})] * count
        colours, which = np.unique(np.round(copies.colours, 5), axis=0, return_inverse=True)
        found = [
            self.append("meshes", {"name": name, "primitives": self._colour(primitives, colour, place)})
            for place, colour in enumerate(colours.tolist())
        ]
        return [found[number] for number in which.reshape(-1).tolist()]

    def _colour(self, primitives: list[dict[str, Any]], colour: list[float], place: int) -> list[Any]:
        """Return primitives of a colour; the first has their own materials, others have copies of them."""
        found = []
        for primitive in primitives:
            at = primitive["material"]
            if place:
                at = self.append("materials", deepcopy(self.lists["materials"][at]))
            self.lists["materials"][at]["pbrMetallicRoughness"]["baseColorFactor"][:3] = colour
            found.append({**primitive, "material": at})
        return found


def quaternions(turns: Floats) -> Floats:
    """Return unit quaternions (N, 4) as x, y, z, w of rotations (N, 3, 3).

    Of four ways to find one, each takes that of the largest component. Source: Markley, *Unit quaternion from
    rotation matrix*, 2008.
    """
    trace = np.trace(turns, axis1=1, axis2=2)
    diagonal = np.diagonal(turns, axis1=1, axis2=2)
    squares = np.column_stack([1.0 + 2.0 * diagonal - trace[:, None], 1.0 + trace])  # four times each
    a = turns.transpose(1, 2, 0)
    products = np.stack(
        [
            [squares[:, 0], a[0, 1] + a[1, 0], a[0, 2] + a[2, 0], a[2, 1] - a[1, 2]],
            [a[0, 1] + a[1, 0], squares[:, 1], a[1, 2] + a[2, 1], a[0, 2] - a[2, 0]],
            [a[0, 2] + a[2, 0], a[1, 2] + a[2, 1], squares[:, 2], a[1, 0] - a[0, 1]],
            [a[2, 1] - a[1, 2], a[0, 2] - a[2, 0], a[1, 0] - a[0, 1], squares[:, 3]],
        ]
    )  # of each component with each
    rows = products[squares.argmax(axis=1), :, np.arange(len(turns))]
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))


def _in_order(turns: np.ndarray) -> np.ndarray:
    """Return quaternions (K, N, 4) of frames, signed so that none goes the long way to the next."""
    signs = np.sign((turns[1:] * turns[:-1]).sum(axis=2, keepdims=True) + 1e-30)
    return np.concatenate([turns[:1], turns[1:] * np.cumprod(signs, axis=0)])


@dataclass(frozen=True, eq=False)
class GltfInstancesExport(AnimationExport):
    """A GLB of rigid copies, whose nodes share a mesh; `plain` files need no extension of materials."""

    plain: bool = False

    form = "gltf_instances"
    ends = ("instances.glb",)

    @property
    def facts(self) -> list[Any]:
        return [self.plain]

    def write_files(self, meshes: list[OneMesh], began: Began) -> str:
        content, count = _CopyNodes(self.plain, compresses=False), 0
        for part in self.parts:
            copies = Instances.of(part, began)
            content.add(copies, part.request.shot.picture.look)
            count += len(copies.placements(copies.mesh.frames[0]))
        self.files.write(self.names[0], self.key, lambda draft: content.write(draft, self.request.name))
        return plural(count, "instance")
