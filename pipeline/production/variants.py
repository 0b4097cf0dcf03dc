"""Which Mitsuba variant renders a shot: the first that works here and has not crashed on it.

The variant is part of every picture's key, so pictures of two variants never stand in one shot.
"""

from __future__ import annotations

import json
from importlib.metadata import version
from pathlib import Path

from pipeline.errors import MachineError
from pipeline.production.disk import disk_faults
from pipeline.production.layout import STATE
from render.engine import DEFAULT_ORDER, choose


def variant_for(root: Path, shot: str, asked: str | None = None) -> str:
    """The variant that `shot` is rendered by: the one asked for, or the first that may serve.

    Raises RenderEnvironmentError where none works, MachineError where the one asked for has crashed.
    """
    avoided = _avoided(root, shot)
    if asked is None:
        return choose([v for v in DEFAULT_ORDER if v not in avoided] or None).variant
    if asked in avoided:
        raise MachineError(f"{avoided[asked]}; leave --variant out to have another one chosen")
    return choose([asked]).variant


def avoid(root: Path, shot: str, variant: str, reason: str) -> bool:
    """Remember that a variant crashed on a shot; whether another is left to try."""
    path = _memory(root, shot)
    known = {**_avoided(root, shot), variant: reason}
    with disk_faults(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps({"mitsuba": version("mitsuba"), "avoid": known}))
    return any(v not in known for v in DEFAULT_ORDER)


def _avoided(root: Path, shot: str) -> dict[str, str]:
    """Variants that crashed on this shot, by name, with the reason; another Mitsuba gets another chance."""
    try:
        memory = json.loads(_memory(root, shot).read_text())
    except (FileNotFoundError, ValueError):
        return {}
    return dict(memory["avoid"]) if memory.get("mitsuba") == version("mitsuba") else {}


def _memory(root: Path, shot: str) -> Path:
    return root / STATE / "variants" / f"{shot}.json"
