"""Choose the Mitsuba variant of a shot: the first that works on this machine and has not failed on the shot.

A GPU is used if it is asked for and works. If it fails, the whole shot falls back to a variant for
processors. The variant is part of every picture's key, so pictures of two variants never stand in one shot.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import cache
from importlib.metadata import version
from pathlib import Path

from pipeline.errors import MachineError
from pipeline.production.store.paths import STATE
from render.base.atomic_write import atomic_write
from render.mitsuba.engine import DEFAULT_ORDER, choose, works

ON_GPU = "cuda_ad_rgb"


def variant_for(root: Path, shot: str, asked: str | None = None, tell: Callable[[str], None] = print) -> str:
    """Return the variant that renders `shot`: the one asked for, or the first that works.

    tell  called with a line that says why another variant replaces a GPU

    Raises MachineError where none works, MachineError where another one asked for has failed.
    """
    avoided = _avoided(root, shot)
    if asked is None:
        return _first_but(avoided)
    if asked == ON_GPU and (asked in avoided or not _gpu_works()):
        absent = f"{asked} cannot render here: Mitsuba finds no NVIDIA GPU with a driver that it can use"
        chosen = _first_but(avoided)
        tell(f"{avoided.get(asked, absent)}; {shot} is rendered with {chosen} instead")
        return chosen
    if asked in avoided:
        raise MachineError(f"{avoided[asked]}; leave --variant out to have another one chosen")
    return choose([asked]).variant


def _first_but(avoided: Mapping[str, str]) -> str:
    return _first_of(tuple(v for v in DEFAULT_ORDER if v not in avoided))


@cache
def _first_of(order: tuple[str, ...]) -> str:
    """Ask once a process, not for every shot."""
    return choose(order or None).variant


@cache
def _gpu_works() -> bool:
    """Ask once a process; a failure is not stored, for a driver may be installed."""
    return works(ON_GPU)


def avoid(root: Path, shot: str, variant: str, reason: str) -> bool:
    """Remember that a variant failed on a shot; return True if another is left to try."""
    path = _memory(root, shot)
    known = {**_avoided(root, shot), variant: reason}
    with atomic_write(path) as draft:
        draft.write_text(json.dumps({"mitsuba": version("mitsuba"), "avoid": known}))
    return any(v not in known for v in DEFAULT_ORDER)


def _avoided(root: Path, shot: str) -> dict[str, str]:
    """Return the variants that failed on this shot and the reasons; a new Mitsuba gets a new chance."""
    try:
        memory = json.loads(_memory(root, shot).read_text())
    except (FileNotFoundError, ValueError):
        return {}
    return dict(memory["avoid"]) if memory.get("mitsuba") == version("mitsuba") else {}


def _memory(root: Path, shot: str) -> Path:
    return root / STATE / "variants" / f"{shot}.json"
