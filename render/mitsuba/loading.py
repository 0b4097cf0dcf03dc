"""Load scenes in Mitsuba such that frames are compiled once and have the same noise each time.

Needs a started engine.
"""

from __future__ import annotations

from typing import Any

from render.mitsuba import absorption

_CHANGING = (
    *("to_world", "medium.scale", absorption.RATE, "aperture_radius", "focus_distance"),
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
    import mitsuba as mi

    return mi.load_dict(description, parallel=False, optimize=False)


def _named_part(name: str, described: Any) -> Any:
    import mitsuba as mi

    part = described
    if isinstance(described, dict):
        part = load_part(described)
        part.set_id(name)
    if mi.variant() != "scalar_rgb":
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
