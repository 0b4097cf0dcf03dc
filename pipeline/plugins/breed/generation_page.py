"""The page of a generation: children that play, favourites, and the command for the next generation.

One HTML file, which asks for no network. Its choice is one line of text, which the page shows in a command
and saves as a file; `breed --from-page` takes either:

    bred/A010_cube_1 parents=3,7 favourites=3,7,9 change=0.3 seed=1 name=calm
"""

from __future__ import annotations

import base64
import json
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flowsculpt import UsageError
from flowsculpt.api import quote
from flowsculpt.api.files import PageFolder
from flowsculpt.api.pictures import jpeg_bytes
from flowsculpt.pipeline.plugins.breed.family_tree import RECORD, read_record

OPTION = "--from-page"

FORM = "bred/A010_cube_1 parents=3,7 favourites=3,7,9 change=0.3 seed=1 name=calm"
"""A choice, as messages show it."""


@dataclass(frozen=True, eq=False)
class PageChild:
    """A child on the page: its changes in words, and its pictures (N, H, W, 3)."""

    name: str
    changes: tuple[str, ...]
    intent: str
    pictures: NDArray[np.uint8]


def page_text(
    record: dict[str, Any],
    folder: str,
    children: Sequence[PageChild],
    parents: Sequence[tuple[str, NDArray[np.uint8]]],
) -> str:
    """Return the page of a generation; `folder` is its path as commands name it."""
    facts = {
        "folder": folder,
        "name": record["name"],
        "generation": record["generation"],
        "seed": record["seed"],
        "change": record["change"],
        "next": next_name(record["name"]),
        "children": [
            {"name": c.name, "changes": list(c.changes), "intent": c.intent, **_film(c.pictures)}
            for c in children
        ],
        "parents": [{"name": name, **_film(pictures)} for name, pictures in parents],
        "aspect": children[0].pictures.shape[2] / children[0].pictures.shape[1],
    }
    title = f"{record['name']}: generation {record['generation']}"
    page = PageFolder(files("flowsculpt.pipeline.plugins.breed") / "page")
    return page.in_one_file(title, {"facts": json.dumps(facts)})


def next_name(name: str) -> str:
    """Return the name of the generation after one: A010_cube_2 after A010_cube_1."""
    stem, _, number = name.rpartition("_")
    return f"{stem}_{int(number) + 1}" if stem and number.isdecimal() else f"{name}_2"


def _film(pictures: NDArray[np.uint8]) -> dict[str, Any]:
    """Return pictures (N, H, W, 3) as a JPEG that has them one below another, and their count."""
    joined = pictures.reshape(-1, *pictures.shape[2:])
    return {"film": base64.b64encode(jpeg_bytes(joined)).decode("ascii"), "count": len(pictures)}


@dataclass(frozen=True)
class PageChoice:
    """A choice made on a page.

    parents     the paths of one or two shot files
    favourites  names of shots
    name        of the next generation
    """

    parents: tuple[Path, ...]
    favourites: tuple[str, ...]
    change: float | None
    seed: int | None
    name: str


def read_choice(text: str) -> PageChoice:
    """Return the choice of a page: its line of text, or a file with it. Raises UsageError."""
    try:
        if Path(text).is_file():
            text = Path(text).read_text(encoding="utf-8")
    except (OSError, ValueError):
        pass
    place = f"{OPTION} {quote(text.strip())}"
    try:
        folder, *words = shlex.split(text)
        given = dict(word.split("=", 1) for word in words)
    except ValueError:
        raise UsageError(f"{place}: not a choice of a page; it is like {FORM}") from None
    if unknown := given.keys() - {"parents", "favourites", "change", "seed", "name"}:
        raise UsageError(f"{place}: {sorted(unknown)[0]} is not part of a choice; it is like {FORM}")
    record = read_record(Path(folder))
    if record is None:
        raise UsageError(
            f"{place}: {folder} is not a generation: it has no {RECORD}. Run this in the folder in which "
            "it was bred"
        )
    names = [child.name for child in record.children]
    parents = _numbered(given.get("parents", ""), names, place)
    if len(parents) not in (1, 2):
        raise UsageError(f"{place}: {len(parents)} parents; choose one child on the page, or two to cross")
    try:
        change = float(given["change"]) if "change" in given else None
        seed = int(given["seed"]) if "seed" in given else None
    except ValueError:
        raise UsageError(f"{place}: change and seed are numbers, as in {FORM}") from None
    favourites = tuple(_numbered(given.get("favourites", ""), names, place))
    paths = tuple(Path(folder) / f"{name}.yaml" for name in parents)
    return PageChoice(paths, favourites, change, seed, given.get("name", "") or next_name(record.name))


def _numbered(text: str, names: Sequence[str], place: str) -> list[str]:
    """Return the names of children with these numbers, each once."""
    numbers = list(dict.fromkeys(word for word in text.split(",") if word))
    for number in numbers:
        if not (number.isdecimal() and 1 <= int(number) <= len(names)):
            raise UsageError(f"{place}: child {quote(number)} does not exist; they are 1 to {len(names)}")
    return [names[int(number) - 1] for number in numbers]
