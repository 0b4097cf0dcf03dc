"""Look up the shots and edits of the working folder by name."""

from __future__ import annotations

import difflib
import re
import shlex
from pathlib import Path

from pipeline.errors import MissingInputError, UsageError
from pipeline.plugin import plugins
from pipeline.shot.yaml.named_files import DEFAULTS, is_edit, is_there, name_fault, shown
from render.base.input_files import kind_of_path

SHOTS = Path("shots")
FILM = SHOTS / "film.yaml"
CORE_MODELS = ("obj", "ply", "stl")
"""Suffixes of models that the core reads, as in `pipeline.mesh.read`, which takes long to import."""

OTHER_MODELS = (
    ".3ds",
    ".abc",
    ".ac",
    ".bgeo",
    ".blend",
    ".lwo",
    ".ma",
    ".max",
    ".mb",
    ".vrml",
    ".wrl",
    ".x3d",
)
"""Endings of model files of formats that are not read, for the message to one who names such a file."""

NO_SHOTS = (
    f"no shots here: {SHOTS}/ is empty. `flowsculpt new A010_first` writes one, "
    "`flowsculpt new --show` a show with its first shot and its edit."
)
"""The message of commands where nothing was begun yet."""


def _is_model(name: str) -> bool:
    return Path(name).suffix.lower().lstrip(".") in (*CORE_MODELS, *plugins().mesh_formats)


def find_shot(name: str) -> Path:
    """Return the file of a shot: a path, or a name in `shots/`.

    Raises MissingInputError with the nearest names, UsageError for a name that frames cannot be called by.
    """
    if _is_model(name) and not is_there(SHOTS / f"{name}.yaml"):
        own = re.sub(r"[^A-Za-z0-9_-]", "_", Path(name).stem)
        raise UsageError(
            f"{shown(name)} is a model, not a shot; flowsculpt new A010_{own} --model "
            f"{shlex.quote(shown(name))} makes a shot of it"
        )
    if Path(name).suffix.lower() in OTHER_MODELS:
        raise UsageError(
            f"{shown(name)} is in a format that is not supported; export the model as FBX, GLB, OBJ or USD"
        )
    path = _path(name)
    if is_edit(path):
        own = "" if path == FILM else f" {shown(name)}"
        raise UsageError(f"{shown(path)} is an edit, not a shot; flowsculpt film{own} renders it")
    _require_name(path, "shot")
    if is_there(path):
        return path
    if kind := kind_of_path(path):
        raise MissingInputError(
            f"{shown(path)}: it is {kind}; a shot is a regular file. Remove or rename it."
        )
    if path == Path(name):
        hint = f"did you mean {path.stem}?" if path.stem in shot_names() else "flowsculpt new makes one"
        raise MissingInputError(f"{shown(name)}: no such shot file; {hint}")
    _require_shots()
    raise MissingInputError(
        f"{shown(path)}: no such shot; {_near(name, shot_names(), 'flowsculpt new makes one')}"
    )


def find_edit(name: str) -> Path:
    """Return the file of an edit: a path, or a name in `shots/`.

    Raises MissingInputError with the nearest names, UsageError for a shot, and for a name that a film cannot
    be called by.
    """
    path = _path(name)
    _require_name(path, "edit")
    hint = _near(path.stem, edit_names(), "flowsculpt new --show writes shots/film.yaml")
    if not is_there(path):
        _require_shots()
        raise MissingInputError(f"{shown(path)}: no such edit; {hint}")
    if path.stem in shot_names() and path.absolute() == (SHOTS / path.name).absolute():
        raise UsageError(
            f"{shown(path)} is a shot, not an edit; flowsculpt render {path.stem} renders it, "
            f"and as for edits, {hint}"
        )
    return path


def names_edit(name: str) -> bool:
    """Tell whether a name, or a path, is that of an edit."""
    path = _path(name)
    return path == FILM or is_edit(path)


def _require_shots() -> None:
    """Raise UsageError where no shot was begun yet."""
    if not shot_names() and not edit_names():
        raise UsageError(NO_SHOTS)


def _path(name: str) -> Path:
    """Return the path of a shot or an edit."""
    return Path(name) if name.endswith((".yaml", ".yml")) else SHOTS / f"{name}.yaml"


def _require_name(path: Path, kind: str) -> None:
    """Raise UsageError for a name that no shot or edit can have."""
    if fault := name_fault(path.stem, kind):
        raise UsageError(f"{shown(path)}: {fault}")


def _near(name: str, known: list[str], otherwise: str) -> str:
    near = difflib.get_close_matches(name, known, n=1) or known[:6]
    return f"did you mean {', '.join(near)}?" if near else f"there are none; {otherwise}"


def shot_names() -> list[str]:
    """Return the names of the shots of the working folder."""
    edits = {FILM.stem, *edit_names()}
    return sorted(
        path.stem for path in SHOTS.glob("*.yaml") if path.stem not in edits and path.name != DEFAULTS
    )


def edit_names() -> list[str]:
    """Return the names of the edits of the working folder; `film` is always an edit."""
    return sorted(path.stem for path in SHOTS.glob("*.yaml") if path == FILM or is_edit(path))
