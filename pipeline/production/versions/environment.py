"""What files are made by, here and now: packages, code, machine."""

from __future__ import annotations

import platform
from importlib.metadata import version
from pathlib import Path
from typing import Any

import psutil

from pipeline.production.keys.digest import (
    FINISH_CODE,
    FRAMING_CODE,
    MOVIE_CODE,
    NORMALS_CODE,
    PICTURE_CODE,
    SIMULATION_CODE,
    code_key,
)
from render.mitsuba.engine import available_cores

PACKAGES = (
    "av",
    "drjit",
    "imageio",
    "llvmlite",
    "mitsuba",
    "numba",
    "numpy",
    "OpenImageIO",
    "pyoidn",
    "trimesh",
)
"""Those that pixels come from."""

CODE = {
    "simulation": SIMULATION_CODE,
    "normals": NORMALS_CODE,
    "framing": FRAMING_CODE,
    "picture": PICTURE_CODE,
    "finish": FINISH_CODE,
    "movie": MOVIE_CODE,
}
"""The parts of flowsculpt that a version's files come from, by the names they have in a provenance."""


def packages() -> dict[str, str]:
    return {"flowsculpt": version("flowsculpt"), **{name: version(name) for name in PACKAGES}}


def code_keys() -> dict[str, str]:
    """By the names of CODE; packages are told apart from them."""
    return {name: code_key(sources) for name, sources in CODE.items()}


def host() -> dict[str, Any]:
    """The machine that this process is on."""
    return {
        "name": platform.node(),
        "system": platform.platform(),
        "python": platform.python_version(),
        "machine": platform.machine(),
        "processor": _processor(),
        "cores": available_cores(),
        "memory_mib": psutil.virtual_memory().total // 2**20,
    }


def _processor() -> str:
    """What the processor calls itself."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return named[0] if named else platform.processor()
