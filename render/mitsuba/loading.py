"""Load scenes in Mitsuba such that frames are compiled once and have the same noise each time.

Needs a started engine.
"""

from __future__ import annotations

import json
from functools import lru_cache
from typing import Any

from flowsculpt.render.mitsuba.engine import is_compiled

RATE = "absorption_rate"
"""Name of the parameter of our absorption (`flowsculpt.render.mitsuba.custom_plugins`)."""

_CHANGING = (
    *("to_world", "medium.scale", RATE, "aperture_radius", "focus_distance"),
    *("sun_direction", "sun_scale", "sky_scale"),
)
"""Ends of the names of parameters that differ from frame to frame."""


def load_scene(scene: dict[str, Any]) -> Any:
    """Load a scene with its parts in order.

    Parts are loaded and changed first: a scene whose shapes change later builds its bounding volumes again.
    Mitsuba's optimizer is off: it merges shapes by the memory addresses of their materials, so emitters would
    change places from one run to the next, and with them the noise.
    """
    import mitsuba as mi

    parts = {name: _named_part(name, part) for name, part in scene.items() if name != "type"}
    return mi.load_dict({"type": scene["type"], **parts}, parallel=False, optimize=False)


def load_part(description: dict[str, Any]) -> Any:
    """Load a part of a scene, or an integrator."""
    import mitsuba as mi

    return mi.load_dict(description, parallel=False, optimize=False)


def load_bsdf(shape: str, description: dict[str, Any]) -> Any:
    """Load the BSDF of a shape, or return that of an earlier frame: the tables of a coated one take 10 ms.

    A description with more than plain values, such as a bitmap, is loaded each time.
    """
    import mitsuba as mi

    try:
        text = json.dumps(description)
    except TypeError:
        return mi.load_dict(description)
    return _plain_bsdf(shape, text)


@lru_cache(maxsize=64)
def _plain_bsdf(shape: str, description: str) -> Any:
    """Load the BSDF of a shape by its description as JSON. Each shape has its own."""
    import mitsuba as mi

    return mi.load_dict(json.loads(description))


_scene_kind: list[object] = []


def forget_other_scenes(kind: object) -> None:
    """Drop the BSDFs of earlier frames if these were of scenes of another kind.

    Compiled code contains all BSDFs that exist, and their numbers: with those of other scenes it takes longer
    to compile, and differs from code compiled before.
    """
    if _scene_kind != [kind]:
        _plain_bsdf.cache_clear()
        _scene_kind[:] = [kind]


def _named_part(name: str, described: Any) -> Any:
    part = described
    if isinstance(described, dict):
        part = load_part(described)
        part.set_id(name)
    if is_compiled():
        _make_opaque(part)
    return part


def _make_opaque(part: Any) -> None:
    """Make transforms and densities data of the compiled code, not constants in it.

    With constants, every frame whose stage moves or grows a little is compiled again, which takes a third of
    a second and space on the disk.
    """
    import drjit as dr
    import mitsuba as mi

    values = mi.traverse(part)
    for name in [name for name in values.keys() if name.endswith(_CHANGING)]:  # noqa: SIM118 not a dict
        dr.make_opaque(values[name])
        values[name] = values[name]
    values.update()
