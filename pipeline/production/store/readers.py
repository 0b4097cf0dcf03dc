"""Read stored files back: whole, finite, and holding what their key promises."""

from __future__ import annotations

import math
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from flowsculpt.pipeline.arrays import AnyArray, Points
from flowsculpt.pipeline.errors import FlowsculptError
from flowsculpt.pipeline.mesh.placed_copies import COPIES, Placements, all_copies, extremes
from flowsculpt.pipeline.production.store.digests import CorruptFileError, digest_of
from flowsculpt.pipeline.production.store.paths import SUFFIXES
from flowsculpt.pipeline.production.store.store import DAMAGED, Key
from flowsculpt.render.base.state_files import UNUSABLE, plain_data
from flowsculpt.render.post.image import read_exr
from flowsculpt.render.scene.aovs import RenderedFrame

if TYPE_CHECKING:
    from flowsculpt.pipeline.animation import MeshFrame

Size = tuple[int, int]
"""Width and height in pixels."""

_FINITE = {"beauty", "albedo", "normal", "position", "matte", "before", "after"}
"""The layers that finished pictures are made of."""


def picture(key: Key, size: Size | None = None) -> Callable[[Path], tuple[RenderedFrame, dict[str, Any]]]:
    """Return a reader of the picture of `key`: layers and header; check its size if one is given."""

    def read(path: Path) -> tuple[RenderedFrame, dict[str, Any]]:
        layers, header = read_exr(path)
        _require_key(path, header.get("key"), key)
        if size is not None and layers.size != size:
            width, height = layers.size
            raise CorruptFileError(f"{path}: {width} × {height} pixels, not {size[0]} × {size[1]}")
        for name in _FINITE & layers.arrays.keys():
            if not math.isfinite(float(layers[name].sum(dtype=np.float64))):
                raise CorruptFileError(f"{path}: its layer {name} has values that are not finite")
        return layers, header

    return read


def arrays(key: Key) -> Callable[[Path], dict[str, AnyArray]]:
    """Return a reader of the arrays of `key`, as `with_key` marks them."""

    def read(path: Path) -> dict[str, AnyArray]:
        named = read_npz(path)
        _require_key(path, str(named.get("key")), key)
        return named

    return read


def mesh_frame(key: Key, number: int) -> Callable[[Path], MeshFrame]:
    """Return a reader of the mesh frame of `key`, which a shot shows as frame `number`."""
    from flowsculpt.pipeline.animation import MeshFrame
    from flowsculpt.pipeline.mesh.meshes import freeze

    def read(path: Path) -> MeshFrame:
        named = arrays(key)(path)
        for values in named.values():
            freeze(values)
        try:
            return MeshFrame.from_arrays(named, number)
        except (FlowsculptError, *UNUSABLE) as error:
            raise CorruptFileError(f"{path}: {error}") from error

    return read


def vertices(key: Key) -> Callable[[Path], Points]:
    """Return a reader of the vertices (V, 3) of the mesh frame of `key`; little else is unpacked.

    Of rigid copies with many vertices it returns those that lie farthest in some direction.
    """

    def read(path: Path) -> Points:
        with _opened(path) as named:
            found, points = str(named["key"]), named["vertices"]
            copies = named.get(COPIES)
        _require_key(path, found, key)
        return points if copies is None else Placements(copies).points(extremes(points))

    return read


def shading(key: Key) -> Callable[[Path], dict[str, AnyArray]]:
    """Return a reader of the arrays of the shaded surface of `key`, with those of all its copies."""
    return lambda path: all_copies(arrays(key)(path))


def with_key(key: Key, named: Mapping[str, AnyArray]) -> dict[str, AnyArray]:
    """Return the arrays and their key."""
    return {**named, "key": np.array(key)}


@dataclass(frozen=True)
class StoredFiles:
    """The files of one kind in a store.

    kind     `raw` and `frame` are pictures, `mesh` frames of a shot's surface, `normals` shaded surfaces;
             `cameras`, `measures` and `statistics` plain data; `png`, `png16` and `jpeg` stills; other kinds
             movies
    DAMAGED  errors that readers raise for a file that must be made again
    """

    kind: str

    DAMAGED: ClassVar = DAMAGED

    @property
    def suffix(self) -> str:
        """The suffix of their names."""
        return SUFFIXES[self.kind]

    def reader(self, key: Key, *, number: int = 0, size: Size | None = None) -> Callable[[Path], Any]:
        """Return a reader of the file of a key, which raises one of DAMAGED where it is damaged.

        It returns the layers of a picture and its header, a MeshFrame, arrays by name, plain data, the pixels
        of a still, or the facts of a movie. Of the kind `shading` it reads a file of `normals`, and returns
        the arrays of all copies.

        number  the frame that a mesh is shown as
        size    what pictures must have: width and height, pixels
        """
        if self.kind in ("raw", "frame"):
            return picture(key, size)
        if self.kind == "mesh":
            return mesh_frame(key, number)
        if self.kind == "shading":
            return shading(key)
        match self.suffix:
            case ".npz":
                return arrays(key)
            case ".json":
                return _plain_content
            case ".png" | ".jpg":
                from flowsculpt.render.post.image import read_png

                return read_png
        from flowsculpt.render.movie.probe import probe_movie

        return probe_movie

    @staticmethod
    def key_in(path: Path) -> Key:
        """Return the key of a file of arrays. Raises one of DAMAGED."""
        with _opened(path) as named:
            return str(named["key"])

    @staticmethod
    def digest_of(path: Path) -> str:
        """Return the digest of a file's bytes by which stores tell damage. Raises OSError."""
        return digest_of(path)

    @staticmethod
    def writer(key: Key, named: Mapping[str, AnyArray]) -> Callable[[Path], None]:
        """Return what writes arrays with their key to a file, as `Store.put` takes it."""
        return partial(write_npz, named=with_key(key, named))

    @staticmethod
    def read_arrays(path: Path) -> dict[str, AnyArray]:
        """Return all arrays of a file. Raises CorruptFileError where it cannot be read to its end."""
        return read_npz(path)


def _plain_content(path: Path) -> Any:
    try:
        return plain_data(path.read_bytes())
    except (ValueError, RecursionError) as error:
        raise CorruptFileError(f"{path}: {error}") from error


LARGE_BYTES = 1 << 22
"""The size of the smallest array that is compressed, if that saves much: 8 ms of CPU time for each MiB."""

SAMPLE_BYTES = 1 << 16
"""Bytes of an array whose compression tells that of all."""

SAVING = 0.4
"""The least part of its bytes that compression must save: less is not worth the time."""


def write_npz(path: Path, named: Mapping[str, AnyArray]) -> None:
    """Write named arrays to a file that `numpy.load` reads; equal arrays give equal bytes.

    Large arrays that compress well are compressed, losslessly and by the fastest method: indices do, and
    coordinates seldom.
    """
    arrays = {name: np.asarray(values) for name, values in named.items()}
    compressed = {name for name, values in arrays.items() if compresses_well(values)}
    with zipfile.ZipFile(path, "w") as archive:
        for name in arrays:
            if name not in compressed:
                _write_member(archive, name, arrays[name])
    if compressed:
        with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
            for name in sorted(compressed):
                _write_member(archive, name, arrays[name])


def compresses_well(values: AnyArray) -> bool:
    """Tell whether an array is large and saves SAVING of its bytes, judged by its middle."""
    if values.nbytes < LARGE_BYTES:
        return False
    rows = max(1, SAMPLE_BYTES * len(values) // values.nbytes)
    middle = values[len(values) // 2 :][:rows].tobytes()
    return len(zlib.compress(middle, 1)) <= (1.0 - SAVING) * len(middle)


def _write_member(archive: zipfile.ZipFile, name: str, values: AnyArray) -> None:
    with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
        np.lib.format.write_array(member, values, allow_pickle=False)


def read_npz(path: Path) -> dict[str, AnyArray]:
    """Return all arrays of a file. Raises CorruptFileError where it cannot be read to its end."""
    with _opened(path) as named:
        return {name: named[name] for name in named.files}


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as named:
            yield named
    except FileNotFoundError:
        raise
    except Exception as error:  # zipfile, zlib and numpy raise a dozen kinds for what is damaged
        raise CorruptFileError(f"{path}: {error}") from error


def _require_key(path: Path, actual: object, key: Key) -> None:
    if actual != key:
        raise CorruptFileError(f"{path}: it is another file's content (its key is {actual})")
