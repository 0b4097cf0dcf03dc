"""Sets: presets of stage, lights and camera, under what a shot says itself and over the defaults."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from flowsculpt.pipeline.shot.yaml.yaml_source import YamlSource
from flowsculpt.render.scene.scene_sets import SETS

PARTS = ("stage", "lights", "camera")
"""Entries that a set decides."""

_TAKEN_BACK = {
    "camera": (
        ({"position"}, {"azimuth", "elevation", "dolly"}),
        ({"distance"}, {"dolly"}),
        ({"focal_length"}, {"field_of_view"}),
        ({"projection"}, {"elevation", "field_of_view", "dolly"}),
    ),
    "lights": (
        ({"sky", "sun", "hdri"}, {"sky", "sun", "hdri"}),
        ({"rig", "softboxes"}, {"rig", "softboxes", "sky", "sun", "hdri"}),
    ),
    "stage": (({"kind"}, {"*"}),),
}
"""By the part of a set: settings of a shot that take back others of the set, all for `*`."""


def set_of(
    source: YamlSource, defaults: YamlSource | None, settings: Iterable[str]
) -> tuple[YamlSource | None, YamlSource | None, bool]:
    """Return the set of a shot as a source; the defaults beside it; and whether it is the shot's own.

    The set that a shot names itself, in its file or by `--set set=NAME`, replaces the parts of the defaults.
    One that the defaults name is under theirs. Unknown names yield no set; documents report them.
    """
    named = [setting.partition("=") for setting in settings]
    written = [value.strip() for name, _, value in named if name.strip() == "set"]
    own = written[-1] if written else source.get("set")
    name = own if own is not None or defaults is None else defaults.get("set")
    above: Mapping[str, Any] = {} if defaults is None else defaults.mapping("sets")
    sets = {**SETS, **above, **source.mapping("sets")}
    if not isinstance(name, str) or not isinstance(sets.get(name), Mapping):
        return None, defaults, False
    if defaults is not None and own is not None:
        data = {entry: value for entry, value in defaults.data.items() if entry not in PARTS}
        defaults = replace(
            defaults.without_places(lambda where: where[:1] in [(p,) for p in PARTS]), data=data
        )
    parts = {part: value for part, value in sets[name].items() if part in PARTS}
    kept = parts if own is None else {part: _beside(parts[part], source.get(part), part) for part in parts}
    return YamlSource(Path(f"set {name}"), kept, {}), defaults, own is not None


def _beside(preset: Any, own: Any, part: str) -> Any:
    """Return what a part of a set keeps beside a shot's own settings of it."""
    if not isinstance(own, Mapping) or not isinstance(preset, Mapping):
        return preset
    for names, taken in _TAKEN_BACK[part]:
        if names & own.keys():
            preset = {name: value for name, value in preset.items() if name not in taken and "*" not in taken}
    return preset
