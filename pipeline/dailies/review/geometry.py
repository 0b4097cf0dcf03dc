"""Mesh frames for the page: positions in 16 bits, normals in 8, as scripts, which a page may load."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.dailies.sheets.measures import simulated
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store import readers
from pipeline.production.store.store import CorruptFileError, Key, Store, key_of
from render.base.atomic_write import atomic_write

FORMAT = 1

BUDGET = 64_000_000
"""Bytes, about, of the meshes of a shot on a page; large meshes come in fewer frames."""


@dataclass(frozen=True)
class PageMeshes:
    """The mesh frames of a shot on a page; `folder` is the page's folder of their scripts."""

    request: RenderRequest
    store: Store
    folder: Path

    def chosen(self, most: int) -> list[int]:
        """Return at most so many simulated frames, evenly spaced, with the first and the last."""
        there = [number for number in sorted(self.request.angles) if self._place(number)]
        if not there or most < 1:
            return []
        largest = max(place[0].stat().st_size for n in there[-3:] if (place := self._place(n)))
        count = max(1, min(most, len(there), BUDGET // max(1, largest)))
        places = np.linspace(0, len(there) - 1, count).round().astype(int)
        return [there[place] for place in dict.fromkeys(places.tolist())]

    def write(self, number: int) -> str | None:
        """Write one frame unless it is there, and return its file's name; None if it cannot be read."""
        place = self._place(number)
        if place is None:
            return None
        path, key = place
        name = f"{model_key(key)}.js"
        if not (self.folder / name).exists():
            try:
                arrays = readers.arrays(key)(path)
            except (CorruptFileError, OSError):
                return None
            with atomic_write(self.folder / name) as draft:
                draft.write_text(as_script(name, arrays))
        return name

    def _place(self, number: int) -> tuple[Path, Key] | None:
        return simulated(self.request, self.store, number, "normals")


def model_key(normals: Key) -> Key:
    return key_of("model", FORMAT, normals)


def as_script(name: str, arrays: dict[str, AnyArray]) -> str:
    """Return a call of the page's `reviewModel` with the arrays of a frame in base64, little-endian.

    positions  uint16 (V, 3), over the box from `low` to `high`, scene units
    normals    int8 (V, 3), of a surface;  radii  float32 (V,), of a cloud
    faces      uint16 or uint32 (F, 3), as `wide` says
    """
    vertices = np.asarray(arrays["vertices"], np.float64)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    extent = np.where(high > low, high - low, 1.0)
    wide = len(vertices) > 2**16
    data: dict[str, Any] = {
        "vertices": len(vertices),
        "low": [round(float(x), 6) for x in low],
        "high": [round(float(x), 6) for x in low + extent],
        "positions": _encoded(np.rint((vertices - low) / extent * 65535.0), "<u2"),
    }
    if "radii" in arrays:
        data["radii"] = _encoded(arrays["radii"], "<f4")
    else:
        data |= {
            "triangles": len(arrays["faces"]),
            "wide": wide,
            "normals": _encoded(np.rint(np.asarray(arrays["normals"]) * 127.0), "i1"),
            "faces": _encoded(arrays["faces"], "<u4" if wide else "<u2"),
        }
    return f"reviewModel({json.dumps(name)}, {json.dumps(data)});\n"


def _encoded(values: AnyArray | Sequence[float], kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values).astype(kind).tobytes()).decode("ascii")
