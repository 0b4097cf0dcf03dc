"""The gallery: shots that come with flowsculpt, with their models, music and films."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from flowsculpt import MachineError
from flowsculpt.api.frames import Show

GALLERY = Path(__file__).resolve().parents[3] / Show().folder
"""The folder, in the wheel as in a checkout: the one beside `pipeline/`."""


@cache
def gallery_names() -> tuple[str, ...]:
    """Return the names of the gallery's shots."""
    return tuple(Show(GALLERY).shots())


def gallery_files() -> dict[Path, Path]:
    """Return all files of the gallery by their paths in a show: those that others name come first.

    Raises MachineError where it was left out of an installation.
    """
    if not gallery_names():
        raise MachineError(f"{GALLERY}: the gallery is missing; install flowsculpt again")
    names = [path.relative_to(GALLERY) for path in sorted(GALLERY.rglob("*")) if path.is_file()]
    names = [name for name in names if not any(part.startswith(".") for part in name.parts)]
    names.sort(key=lambda name: (name.suffix == ".yaml", Show().names_edit(str(GALLERY / name))))
    return {Show().folder / name: GALLERY / name for name in names}
