"""Write moving sculptures as one binary glTF file: keyframes are morph targets, blended in turn."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flowsculpt.api.materials import Material
from flowsculpt.api.meshes import Floats
from flowsculpt.pipeline.plugins.interchange.drawn_mesh import KeyPoses
from flowsculpt.pipeline.plugins.interchange.gltf_content import FLOAT, SHORT, GltfContent
from flowsculpt.pipeline.plugins.interchange.meshopt_encoder import exponential_elements

_NORMAL_EXPONENT = -7  # components of normals are multiples of 1/128, as in bytes


class Moving(NamedTuple):
    """A sculpture of a file: its name, motion and look, and its second texture coordinates (W, 2) if any.

    Texture coordinates go to the right and upwards; the second ones to the right and downwards, as in glTF.
    """

    name: str
    keyframes: KeyPoses
    look: Material
    second: Floats | None = None


def write_animated_gltf(path: Path, clip: str, parts: Sequence[Moving], plain: bool = False) -> None:
    """Write sculptures and one animation clip, which begins at the first frame.

    plain  write float32 without extensions

    Raises UsageError where the file would be larger than its format allows, MachineError where the disk
    refuses.
    """
    _animation(parts, plain, compresses=True).write(path, clip)


def quantized_animation(clip: str, parts: Sequence[Moving]) -> bytes:
    """Return a GLB as `write_animated_gltf` writes it, in whole steps without compression.

    Raises UsageError where it would be larger than its format allows.
    """
    return _animation(parts, plain=False, compresses=False).glb(clip, clip)


def _animation(parts: Sequence[Moving], plain: bool, compresses: bool) -> GltfContent:
    content = _Animation(plain, compresses)
    for part in parts:
        content.add(part)
    return content


class _Animation(GltfContent):
    """The content of a file, as moving sculptures are added."""

    def add(self, part: Moving) -> None:
        """Add a sculpture: its mesh, material, node, and the weights of its keyframes."""
        keys, drawn = part.keyframes, part.keyframes.drawn
        attributes = self._pose(keys.places[0], keys.normals[0], keys, base=True)
        first = part.second if drawn.texture is None else drawn.texture * (1.0, -1.0) + (0.0, 1.0)
        for number, coordinates in enumerate((first, part.second)):
            if coordinates is not None:
                attributes[f"TEXCOORD_{number}"] = self.floats(coordinates, "VEC2")
        if (colours := drawn.colours) is not None:
            attributes["COLOR_0"] = self.colours(colours)
        primitives = self.primitives(attributes, drawn.faces, drawn.materials, part.look, drawn.is_closed)
        mesh: dict[str, Any] = {"name": part.name, "primitives": primitives}
        count = len(keys.numbers) - 1
        if count:
            targets = [
                self._pose(place - keys.places[0], normal - keys.normals[0], keys, base=False)
                for place, normal in zip(keys.places[1:], keys.normals[1:], strict=True)
            ]
            for primitive in primitives:
                primitive["targets"] = targets
            mesh["weights"] = [0.0] * count
            mesh["extras"] = {"targetNames": [f"frame {number}" for number in keys.numbers[1:]]}
        node: dict[str, Any] = {"name": part.name, "mesh": self.append("meshes", mesh)}
        if not self.plain:
            node |= {"translation": keys.centre.tolist(), "scale": [keys.step] * 3}
        self.append("nodes", node)
        if count:
            self._weigh(len(self.lists["nodes"]) - 1, keys)

    def _weigh(self, node: int, keys: KeyPoses) -> None:
        """Add a channel that blends from each pose to the next one; at the first all weights are 0."""
        numbers, mesh = np.array(keys.numbers), keys.drawn.mesh
        times = self.times(mesh, numbers)
        weights = np.eye(len(numbers), dtype="<f4")[:, 1:]
        when = self.accessor(self.raw(times), times, "SCALAR", FLOAT, bounded=True)
        output = self.accessor(self.raw(weights), weights.reshape(-1), "SCALAR", FLOAT)
        self.animate(node, "weights", when, output)

    def _pose(self, place: np.ndarray, normal: np.ndarray, keys: KeyPoses, base: bool) -> dict[str, int]:
        """Add positions and normals of a pose, or of the difference between two."""
        if self.plain:
            offset = keys.centre if base else 0.0
            points = (place * keys.step + offset).astype("<f4")
            return {
                "POSITION": self.accessor(self.vertices(points), points, "VEC3", FLOAT, bounded=True),
                "NORMAL": self.floats(normal, "VEC3"),
            }
        self.used.add("KHR_mesh_quantization")
        rows = np.zeros((len(place), 4), "<i2")  # elements begin at multiples of four bytes
        rows[:, :3] = place
        position = self.accessor(self.vertices(rows), rows[:, :3], "VEC3", SHORT, bounded=True)
        if base:
            bytes_ = np.zeros((len(normal), 4), np.int8)
            bytes_[:, :3] = np.rint(normal * 127.0)
            held = self.accessor(self.vertices(bytes_), bytes_, "VEC3", 5120, normalized=True)
        elif not self.compresses:  # differences reach from -2 to 2, which normalized bytes cannot hold
            held = self.floats(
                np.ldexp(np.rint(np.ldexp(normal, -_NORMAL_EXPONENT)), _NORMAL_EXPONENT), "VEC3"
            )
        else:
            elements = exponential_elements(normal, _NORMAL_EXPONENT)
            held = self.accessor(self.compressed(elements, "EXPONENTIAL"), elements, "VEC3", FLOAT)
        return {"POSITION": position, "NORMAL": held}


def closes(keyframes: Iterable[KeyPoses]) -> bool:
    """Tell whether the last pose is the first one, so that a clip repeats without a jump."""
    return all((keys.places[0] == keys.places[-1]).all() for keys in keyframes)
