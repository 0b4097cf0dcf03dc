"""Named arrays in one uncompressed file, always the same bytes for the same arrays."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.production.store.store import CorruptFileError


def write_npz(path: Path, arrays: Mapping[str, AnyArray]) -> None:
    np.savez(path, allow_pickle=False, **arrays)


def read_npz(path: Path) -> dict[str, AnyArray]:
    """All arrays of the file. Raises CorruptFileError where it cannot be read to its end."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except (zipfile.BadZipFile, ValueError, KeyError, EOFError) as error:
        raise CorruptFileError(f"{path}: {error}") from error
