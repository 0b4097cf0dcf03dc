"""The meshes of the page's 3-D view, which three.js draws: some frames as simulated, all as one mesh.

A page may load scripts but no data: meshes are scripts, with positions in 16 bits and normals in 8. One mesh
is made by a plug-in for animations; its GLB is deflated.
"""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from flowsculpt import FlowsculptError
from flowsculpt.api import ShotExtras
from flowsculpt.api.frames import FrameRange, RenderRequest, Store, StoredFiles, key_of
from flowsculpt.pipeline.plugins.review.measures import simulated

FORMAT = 3

_OF_VERTICES = ("vertices", "normals")

MOST_VERTICES = 60_000
"""Vertices of one mesh of each subject."""

BUDGET = 64_000_000  # bytes, about, of the meshes of a shot on a page; large meshes come in fewer frames


@dataclass(frozen=True)
class PageMeshes:
    """The mesh frames of a shot on a page; `folder` is the page's folder of their scripts."""

    request: RenderRequest
    store: Store
    folder: Path

    def chosen(self, most: int) -> list[int]:
        """Return at most so many simulated frames, evenly spaced, with the first and the last."""
        numbers = list(self._simulated)
        if not numbers or most < 1:
            return []
        last = [self._simulated[number] for number in numbers[-3:]]
        largest = max(sum(path.stat().st_size for path, _ in files) for files in last)
        count = max(1, min(most, len(numbers), BUDGET // max(1, largest)))
        indices = np.linspace(0, len(numbers) - 1, count).round().astype(int)
        return [numbers[index] for index in dict.fromkeys(indices.tolist())]

    def write(self, number: int) -> str | None:
        """Write one frame unless it is there, and return its file's name; None if it cannot be read."""
        files = self._simulated[number]
        keys = [key for _, key in files]
        name = f"{key_of('model', FORMAT, keys if len(keys) > 1 else keys[0])}.js"
        if not self.store.is_whole(self.folder / name):
            try:
                for path, _ in files:
                    self.store.digests.check(path)
                arrays = joined([StoredFiles("shading").reader(key)(path) for path, key in files])
            except (*StoredFiles.DAMAGED, OSError):
                return None
            self._write(name, as_script(name, arrays))
        return name

    def write_motion(self, began: Callable[[str, int], Callable[[], None]]) -> dict[str, Any]:
        """Write all simulated frames as one mesh unless it is there.

        began  called with the name of each part of the work and its number of steps; returns what is called
               after each

        Returns `file` and `first`, the frame where the motion begins; or `without`, why there is none.
        """
        numbers, name = FrameRange(self._simulated), self.request.name
        if len(numbers) < 2:
            return {"without": ""}
        for number, files in self._simulated.items():
            if [key for _, key in files] != [part.keys.normals(number) for part in self.request.parts]:
                return {"without": f"{name} has changed since frame {number} was simulated; render it again."}
        without = "no plug-in makes animations."
        request = replace(self.request, requested=numbers)
        for extras in ShotExtras.of_plugins().values():
            try:
                animation = extras.animation(request, self.store, MOST_VERTICES)
                if animation is None:
                    continue
                file = f"{key_of('motion', FORMAT, animation.key)}.js"
                if not self.store.is_whole(self.folder / file):
                    data = {"glb": _encoded(np.frombuffer(zlib.compress(animation.glb(began)), "u1"), "u1")}
                    self._write(file, _call(file, data))
                return {"file": file, "first": numbers[0]}
            except FlowsculptError as error:
                without = f"{error}."
        return {"without": without}

    def _write(self, name: str, script: str) -> None:
        self.store.write(self.folder / name, lambda draft: draft.write_text(script, encoding="utf-8"))

    @cached_property
    def _simulated(self) -> dict[int, list[tuple[Path, str]]]:
        """Path and key of the normals of each subject, of the frames of which all are simulated."""
        return {n: found for n in sorted(self.request.angles) if (found := self._files(n))}

    def _files(self, number: int) -> list[tuple[Path, str]]:
        """Return path and key of the normals of each subject of a frame; none unless all are simulated."""
        files = [simulated(part, self.store, number, "normals") for part in self.request.parts]
        found = [file for file in files if file is not None]
        return found if len(found) == len(files) else []


def joined(subjects: Sequence[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Join the surfaces of a frame to one, and its clouds to one.

    Returns `vertices`, `normals` and `faces` of the surfaces, and `centres` and `radii` of the clouds. A
    frame without surfaces, or without clouds, has none of theirs.
    """
    surfaces = [arrays for arrays in subjects if "faces" in arrays]
    clouds = [arrays for arrays in subjects if "faces" not in arrays]
    together: dict[str, np.ndarray] = {}
    if surfaces:
        starts = np.cumsum([0, *(len(arrays["vertices"]) for arrays in surfaces[:-1])])
        faces = [arrays["faces"] + start for arrays, start in zip(surfaces, starts, strict=True)]
        together = {name: np.concatenate([arrays[name] for arrays in surfaces]) for name in _OF_VERTICES}
        together["faces"] = np.concatenate(faces)
    if clouds:
        together["centres"] = np.concatenate([arrays["vertices"] for arrays in clouds])
        together["radii"] = np.concatenate([arrays["radii"] for arrays in clouds])
    return together


def as_script(name: str, arrays: dict[str, np.ndarray]) -> str:
    """Return a call of the page's `reviewModel` with the arrays of `joined` in base64, little-endian.

    low, high           corners of the box of all, scene units
    positions, centres  uint16 (V, 3), from `low` in units of `step`
    normals             int8 (V, 3), of the surface
    faces               uint16 or uint32 (F, 3), as `wide` says
    radii               float32 (P,), of the cloud, scene units
    """
    low, high = _bounds(arrays)
    step = float((high - low).max() or 1.0) / 65535.0

    def packed(points: np.ndarray) -> str:
        return _encoded(np.rint((np.asarray(points, np.float64) - low) / step), "<u2")

    data: dict[str, Any] = {"low": low.tolist(), "high": high.tolist(), "step": step}
    if "faces" in arrays:
        wide = len(arrays["vertices"]) > 2**16
        data |= {
            "triangles": len(arrays["faces"]),
            "wide": wide,
            "positions": packed(arrays["vertices"]),
            "normals": _encoded(np.rint(np.asarray(arrays["normals"]) * 127.0), "i1"),
            "faces": _encoded(arrays["faces"], "<u4" if wide else "<u2"),
        }
    if "centres" in arrays:
        data |= {
            "points": len(arrays["centres"]),
            "centres": packed(arrays["centres"]),
            "radii": _encoded(arrays["radii"], "<f4"),
        }
    return _call(name, data)


def _call(name: str, data: dict[str, Any]) -> str:
    return f"reviewModel({json.dumps(name)}, {json.dumps(data)});\n"


def _bounds(arrays: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return the least and the greatest coordinates (3,) of the vertices, and of the balls around centres."""
    ends = [np.asarray(arrays["vertices"], np.float64)] if "faces" in arrays else []
    if "centres" in arrays:
        centres, radii = np.asarray(arrays["centres"], np.float64), arrays["radii"][:, None]
        ends += [centres - radii, centres + radii]
    points = np.concatenate(ends)
    return points.min(axis=0), points.max(axis=0)


def _encoded(values: np.ndarray | Sequence[float], kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values).astype(kind).tobytes()).decode("ascii")
