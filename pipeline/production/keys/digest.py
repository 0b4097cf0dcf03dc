"""Keys: what a file was made from, as a short hash.

A key is the SHA-256 of canonical JSON (sorted names, shortest round-trip numbers), cut to 128 bits.
Two files with the same key hold the same content, wherever and whenever they were made; what does not
change the content (a comment, the order of a YAML mapping, a file's time) must stay out of it.
"""

from __future__ import annotations

import hashlib
import json
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

Key = str

_ROOM = Path(__file__).parents[3]

_CANONICAL = json.JSONEncoder(sort_keys=True, separators=(",", ":"), allow_nan=False)


def _all_but(folder: str, *names: str) -> tuple[str, ...]:
    """The modules of a folder, those of these names left out."""
    files = sorted((_ROOM / folder).glob("*.py"))
    return tuple(f"{folder}/{file.name}" for file in files if file.stem not in names)


SIMULATION_CODE = (
    *_all_but("pipeline/mesh", "patches", "_kernels_patches", "bspline", "write"),
    "pipeline/resample",
    "pipeline/flow",
    "pipeline/animation",
    "pipeline/formula",
    *(f"pipeline/{name}.py" for name in ("__init__", "frames", "kernels", "statistics")),
    *(
        f"pipeline/shot/{name}.py"
        for name in ("clock", "motion", "subject", "cloud", "net", "documents/resampling")
    ),
)
"""What moves vertices. What reads shot files is no part of it: the values that it reads are."""

NORMALS_CODE = (
    *(
        f"pipeline/mesh/{name}.py"
        for name in ("normals", "_kernels_normals", "patches", "_kernels_patches", "bspline", "lattice")
    ),
    "pipeline/resample/creases.py",
    "pipeline/production/render_inputs/shading.py",
    "pipeline/production/tasks/meshes.py",
)
FRAMING_CODE = (
    *(f"pipeline/production/render_inputs/{name}.py" for name in ("framing", "framing_geometry")),
    *(f"pipeline/mesh/{name}.py" for name in ("bspline", "lattice")),
)
PICTURE_CODE = (
    *(
        f"render/frame/{name}.py"
        for name in (
            "render_frame",
            "sample_batches",
            "adaptive_sampling",
            "checkpoint",
            "motion_samples",
            "aovs",
        )
    ),
    *(
        f"render/integrator/{name}.py"
        for name in ("path_tracer", "light_sampler", "sampler", "low_discrepancy")
    ),
    *(
        f"render/mitsuba/{name}.py"
        for name in (
            "scene",
            "mesh",
            "materials",
            "absorption",
            "texture_coordinates",
            "gouraud",
            "vertex_colours",
            "bitmaps",
            "bsdf_check",
            "emitters",
            "stage_shapes",
            "sensor",
        )
    ),
    *(
        f"render/scene/{name}.py"
        for name in (
            "surface",
            "spheres",
            "wireframe",
            "patterns",
            "noise",
            "_kernels_noise",
            "measure",
            "colour_maps",
            "textures",
            "texture_projection",
            "bsdf",
            "lights",
            "daylight",
            "environment",
            "stage",
            "reference_objects",
            "camera",
            "inside",
        )
    ),
    "render/base/kernel_cache.py",
    "render/post/image.py",
    *(f"pipeline/production/render_inputs/{name}.py" for name in ("framing", "motion", "dicing")),
    "pipeline/production/tasks/render.py",
)
FINISH_CODE = (
    *(f"render/post/{name}.py" for name in ("denoise", "temporal_denoise", "_kernels_steady", "image")),
    *(f"render/scene/{name}.py" for name in ("camera", "stage")),
    "render/base/kernel_cache.py",
    "pipeline/production/tasks/finish.py",
)
MOVIE_CODE = (
    "render/base/kernel_cache.py",
    *(f"render/post/{name}.py" for name in ("_kernels_view", "colour", "dither", "view")),
    "render/graphics/titles.py",
    *(f"render/movie/{name}.py" for name in ("prefetch", "dissolve")),
    *(
        f"render/movie/{name}.py"
        for name in ("movie", "codecs", "encode", "planes", "_kernels_planes", "sink", "sound", "track")
    ),
    "pipeline/production/tasks/movies.py",
)
STILL_CODE = (
    "render/base/kernel_cache.py",
    *(f"render/post/{name}.py" for name in ("_kernels_view", "colour", "dither", "image", "view")),
    "pipeline/production/tasks/stills.py",
)


def key_of(*parts: Any) -> Key:
    """The key of plain data: None, bool, int, float, str, lists, tuples and mappings of these.

    Raises TypeError for anything else, and ValueError for NaN or infinity, which JSON cannot say.
    """
    return hashlib.sha256(_CANONICAL.encode(parts).encode()).hexdigest()[:32]


@cache
def code_key(sources: tuple[str, ...], packages: tuple[str, ...] = ()) -> Key:
    """The key of source files (folders are taken whole) and of the versions of the packages they rest on."""
    digest = hashlib.sha256()
    for source in sources:
        place = _ROOM / source
        for file in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            digest.update(file.relative_to(_ROOM).as_posix().encode())
            digest.update(file.read_bytes())
    for package in packages:
        digest.update(f"{package}={version(package)}".encode())
    return digest.hexdigest()[:32]
