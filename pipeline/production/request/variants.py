"""Choose the Mitsuba variant of a shot: the first that works on this machine and has not failed on the shot.

A GPU is used if it is asked for and works. If it fails, the whole shot falls back to a variant for
processors. The variant is part of every picture's key, so pictures of two variants never stand in one shot.

A variant that is named for the nodes of a farm is not tried on the machine that plans: each node does so
before it renders, and says what it lacks.
"""

from __future__ import annotations

import json
import platform
from collections.abc import Callable, Mapping
from functools import cache
from importlib.metadata import version
from pathlib import Path

from pipeline.errors import MachineError, UsageError, suggestion
from pipeline.production.store.paths import STATE
from render.base.atomic_write import atomic_write
from render.mitsuba.engine import DEFAULT_ORDER, VARIANTS, choose, works
from render.mitsuba.llvm import OLDEST_VERSION

ON_GPU = "cuda_ad_rgb"

_LACKING = {
    ON_GPU: "Mitsuba finds no NVIDIA GPU with a driver that it can use",
    "llvm_ad_rgb": f"it has no libLLVM of version {OLDEST_VERSION} or later that works; on Debian and Ubuntu "
    "`python -m render.mitsuba.engine` there fetches one",
}
"""Reasons why a machine cannot use a variant, by variant."""


class VariantError(MachineError):
    """Raised where a node cannot render with the variant of its plan."""


def require_variant(variant: str) -> None:
    """Raise VariantError, with the name of this machine, where it cannot render with a plan's variant."""
    try:
        choose([variant])
    except MachineError:
        lacking = _LACKING.get(variant, "a sample does not render; `flowsculpt doctor` there says more")
        raise VariantError(
            f"{platform.node()} cannot render with {variant}, the variant of this plan: {lacking}. Keep its "
            "jobs off this node, or name another variant by --variant or in the profile's config, and plan "
            "again"
        ) from None


def variant_for(
    root: Path,
    shot: str,
    asked: str | None = None,
    tell: Callable[[str], None] = print,
    on_nodes: bool = False,
) -> str:
    """Return the variant that renders `shot`: the one asked for, or the first that works here.

    tell      called with a line that says why another variant replaces a GPU
    on_nodes  nodes of a farm render: a variant asked for need not work here

    Raises UsageError for a variant that is not known, MachineError where none works, MachineError where
    another one asked for has failed.
    """
    avoided = _avoided(root, shot)
    if asked is None:
        return _first_but(avoided)
    if on_nodes and asked not in avoided:
        if asked not in VARIANTS:
            raise UsageError(f"{asked!r} is not a variant of Mitsuba. {suggestion(asked, VARIANTS)}")
        return asked
    if asked == ON_GPU and (asked in avoided or not _gpu_works()):
        absent = f"{asked} cannot render here: {_LACKING[ON_GPU]}"
        chosen = _first_but(avoided)
        tell(f"{avoided.get(asked, absent)}; {shot} is rendered with {chosen} instead")
        return chosen
    if asked in avoided:
        raise MachineError(f"{avoided[asked]}; leave out --variant to have another one chosen")
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
        draft.write_text(json.dumps({"mitsuba": version("mitsuba"), "avoid": known}), encoding="utf-8")
    return any(v not in known for v in DEFAULT_ORDER)


def _avoided(root: Path, shot: str) -> dict[str, str]:
    """Return the variants that failed on this shot and the reasons; a new Mitsuba gets a new chance."""
    try:
        memory = json.loads(_memory(root, shot).read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError):
        return {}
    return dict(memory["avoid"]) if memory.get("mitsuba") == version("mitsuba") else {}


def _memory(root: Path, shot: str) -> Path:
    return root / STATE / "variants" / f"{shot}.json"
