"""Compare the results of two roots: `python -m benchmarks.same_results ROOT OTHER`, both made on one machine.

Every mesh, picture and movie below `renders/` that both roots hold is read and compared value for value, so
that a change of the code that should change no result can be shown to change none. Headers, compression and
file times may differ. Exit code 1 where a value differs or a root lacks files of the other.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import imageio.v3 as iio
import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

ARRAYS = ("vertices", "faces", "normals", "radii", "creases", "source_vertex", "attribute:identity", "births")
"""The arrays of mesh files that are compared, where a file holds them."""

KINDS = {
    ".npz": "meshes",
    ".exr": "pictures",
    ".png": "pictures",
    ".jpg": "pictures",
    ".mp4": "movies",
    ".mov": "movies",
}


def mesh(path: Path) -> Iterator[NDArray[Any]]:
    """Yield the arrays of a mesh file."""
    with np.load(path) as file:
        yield from (file[name] for name in ARRAYS if name in file.files)


def picture(path: Path) -> Iterator[NDArray[Any]]:
    """Yield the pixels of a picture, channels in the order of their names."""
    source = oiio.ImageInput.open(str(path))
    if source is None:
        raise OSError(f"{path} cannot be read: {oiio.geterror()}")
    spec = source.spec()
    order = np.argsort(spec.channelnames)
    yield source.read_image(0, 0, 0, spec.nchannels)[..., order]
    source.close()


def movie(path: Path) -> Iterator[NDArray[Any]]:
    """Yield the decoded frames of a movie."""
    yield from iio.imiter(path, plugin="pyav")


READERS = {"meshes": mesh, "pictures": picture, "movies": movie}


def is_same(path: Path, other: Path) -> bool:
    """Tell whether two files hold the same values, NaN equal to NaN."""
    read = READERS[KINDS[path.suffix]]
    arrays, others = list(read(path)), list(read(other))
    return len(arrays) == len(others) and all(
        a.shape == b.shape and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
        for a, b in zip(arrays, others, strict=True)
    )


def files_of(root: Path) -> set[Path]:
    """Return the files below `renders/` that can be compared, relative to the root."""
    found = (root / "renders").rglob("*")
    return {file.relative_to(root) for file in found if file.suffix in KINDS}


def main(root: Path, other: Path) -> int:
    """Print what was compared and what differs."""
    files, others = files_of(root), files_of(other)
    same: Counter[str] = Counter()
    wrong = [f"only in {root}: {file}" for file in sorted(files - others)]
    wrong += [f"only in {other}: {file}" for file in sorted(others - files)]
    for file in sorted(files & others):
        if is_same(root / file, other / file):
            same[KINDS[file.suffix]] += 1
        else:
            wrong.append(f"differs: {file}")
    print("the same:", ", ".join(f"{count} {kind}" for kind, count in sorted(same.items())) or "nothing")
    print(*wrong, sep="\n", end="\n" if wrong else "")
    return bool(wrong) or not same


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2])))
