"""What is read back from the store: whole, finite, and what its name says it is."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.errors import MeshError, UsageError
from pipeline.production.keys.digest import Key
from pipeline.production.store.npz import read_npz
from pipeline.production.store.store import CorruptFileError
from render.frame.rendered_frame import RenderedFrame
from render.post.image import read_exr

if TYPE_CHECKING:
    from pipeline.animation import MeshFrame

Size = tuple[int, int]
"""Width and height in pixels."""

_USED = {"beauty", "albedo", "normal", "position", "matte", "before", "after"}
"""The layers that finished pictures are made of."""


def picture(key: Key, size: Size | None = None) -> Callable[[Path], tuple[RenderedFrame, dict[str, Any]]]:
    """Reads the picture of a key: its layers, and its header. Its size is looked at where one is given."""

    def read(path: Path) -> tuple[RenderedFrame, dict[str, Any]]:
        layers, header = read_exr(path)
        _require_key(path, header.get("key"), key)
        if size is not None and layers.size != size:
            raise CorruptFileError(f"{path}: {layers.size[0]} × {layers.size[1]} pixels, not {_times(size)}")
        for name in _USED & layers.arrays.keys():
            pixels = layers[name]
            if not math.isfinite(float(pixels.sum(dtype=np.float64))):
                raise CorruptFileError(f"{path}: not all of its layer {name} is finite")
        return layers, header

    return read


def arrays(key: Key) -> Callable[[Path], dict[str, AnyArray]]:
    """Reads the arrays of a key, which are written by `keyed`."""

    def read(path: Path) -> dict[str, AnyArray]:
        found = read_npz(path)
        _require_key(path, str(found.get("key")), key)
        return found

    return read


def mesh_frame(key: Key) -> Callable[[Path], MeshFrame]:
    """Reads the mesh frame of a key."""
    from pipeline.animation import MeshFrame

    def read(path: Path) -> MeshFrame:
        try:
            return MeshFrame.from_arrays(arrays(key)(path))
        except (UsageError, MeshError) as error:
            raise CorruptFileError(f"{path}: {error}") from error

    return read


def keyed(key: Key, named: Mapping[str, AnyArray]) -> dict[str, AnyArray]:
    """Arrays that say of which key they are."""
    return {**named, "key": np.array(key)}


def _require_key(path: Path, found: object, key: Key) -> None:
    if found != key:
        raise CorruptFileError(f"{path}: it is another file's content (its key is {found})")


def _times(size: Size) -> str:
    return f"{size[0]} × {size[1]}"
