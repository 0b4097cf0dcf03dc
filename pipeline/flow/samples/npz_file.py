"""Fields in numpy's archives: only the arrays of a field are read.

The format is described in numpy's documentation, *numpy.lib.format*.
"""

from __future__ import annotations

import io
import math
import zipfile
from pathlib import Path

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.errors import UsageError
from pipeline.flow.samples.checks import MAX_BYTES, require_size

NAMES = ("x", "y", "z", "t", "velocity")

_HEADER = 1 << 14
"""Bytes that are enough for the header of any array of numbers."""


def read_npz(file: Path, content: bytes, most: int = MAX_BYTES) -> tuple[list[AnyArray], AnyArray, AnyArray]:
    """Return arrays x, y, z; times; and velocity (T, X, Y, Z, 3), (X, Y, Z, 3) in a file without t.

    most  bytes of all arrays as float64; checked by their headers before anything is unpacked

    Raises UsageError where an array is missing or they are too large, and the errors of zipfile and numpy.
    """
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        names_there = {name.removesuffix(".npy") for name in archive.namelist() if name.endswith(".npy")}
        missing = [name for name in NAMES if name != "t" and name not in names_there]
        if missing:
            known = ", ".join(sorted(names_there)) or "nothing"
            raise UsageError(
                f"{file}: array {missing[0]} is missing; a field has x, y, z and velocity. "
                f"There are: {known}."
            )
        names = [name for name in NAMES if name in names_there]
        numbers = sum(_numbers(archive, name) for name in names)
        require_size(file, [-(-numbers // 3)], most)
        arrays = {name: _array(archive, name) for name in names}
    velocity = arrays["velocity"]
    return (
        [arrays[name] for name in "xyz"],
        arrays.get("t", np.zeros(1)),
        velocity if "t" in arrays else velocity[None],
    )


def _numbers(archive: zipfile.ZipFile, name: str) -> int:
    """Return how many float64 an array fills by its header; wider elements count as several."""
    with archive.open(f"{name}.npy") as packed:
        head = io.BytesIO(packed.read(_HEADER))
    read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    version = np.lib.format.read_magic(head)
    if version not in read:
        raise ValueError(f"array {name} has a header of version {version[0]}, which no field has")
    shape, _, dtype = read[version](head)
    return math.prod(map(abs, shape)) * max(1, -(-dtype.itemsize // 8))


def _array(archive: zipfile.ZipFile, name: str) -> AnyArray:
    with archive.open(f"{name}.npy") as packed:
        found: AnyArray = np.lib.format.read_array(packed, allow_pickle=False)
    return found
