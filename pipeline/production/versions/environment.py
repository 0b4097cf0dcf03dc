"""What files are made by, here and now: packages, code, machine."""

from __future__ import annotations

import platform
from importlib.metadata import version
from pathlib import Path
from typing import Any

import psutil

from pipeline.production.keys.stages import ASSEMBLE, FINISH, FRAME_CAMERA, RENDER, SIMULATE, SMOOTH_NORMALS
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


def packages() -> dict[str, str]:
    return {"flowsculpt": version("flowsculpt"), **{name: version(name) for name in PACKAGES}}


def stage_versions() -> dict[str, int]:
    """Return the versions of the stages that a published version comes from."""
    stages = (SIMULATE, SMOOTH_NORMALS, FRAME_CAMERA, RENDER, FINISH, ASSEMBLE)
    return {stage.name: stage.version for stage in stages}


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
