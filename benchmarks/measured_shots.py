"""Shots that benchmarks measure: the gallery and, in `benchmarks/shots`, some that it no longer shows."""

from __future__ import annotations

from pathlib import Path
from shutil import copytree

FOLDERS = (Path(__file__).parents[1] / "shots", Path(__file__).parent / "shots")


def shot_file(name: str) -> Path:
    """Return the file of a shot. Raises FileNotFoundError."""
    for folder in FOLDERS:
        if (found := folder / f"{name}.yaml").is_file():
            return found
    raise FileNotFoundError(f"{name}: no such shot in shots or benchmarks/shots")


def copy_shots(root: Path) -> None:
    """Copy all shots, and the files that they name, to `root`/shots."""
    for folder in FOLDERS:
        copytree(folder, root / "shots", symlinks=True, dirs_exist_ok=True)


def gallery() -> list[str]:
    """Return the names of the gallery's shots."""
    return sorted(file.stem for file in FOLDERS[0].glob("[AB]*.yaml"))
