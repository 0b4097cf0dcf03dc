"""Layers of EXR files: channels by layer, part and view, and the choice of the one that is the picture.

Renderers write many layers, as channels of one part (`ViewLayer.Combined.R`) or as parts with names.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from flowsculpt.render.base.render_errors import reason_of

BEAUTY = (
    "beauty", "combined", "rgba", "rgb", "composite", "c", "ci", "color", "colour", "main", "masterlayer",
    "image", "basecolor", "base_color", "diffuse", "albedo",
)  # fmt: skip
"""Names of layers that are the picture, without their paths, the best first."""

_COLOURS = (("r", "g", "b"), ("red", "green", "blue"))
_VECTOR = ("x", "y", "z")
_MOST_NAMED = 8


@dataclass(frozen=True)
class ExrPart:
    """A part of a file: its name, the eye or camera that it shows, and the names of its channels."""

    name: str
    view: str
    channels: tuple[str, ...]


@dataclass(frozen=True)
class Layer:
    """Channels of one part, by index: three, or one of grey. `name` is empty for the default layer."""

    name: str
    part: int
    channels: tuple[int, ...]


def choose_layer(parts: Sequence[ExrPart], views: Sequence[str] = ()) -> Layer:
    """Return the layer that is the picture: the default one, else the beauty, else the only one.

    views  the file's views, the default one first; by default the left one, or that of the first part

    Raises ValueError with the layers where none of them is meant.
    """
    named = list(views) or [part.view for part in parts if part.view] or _stereo(parts)
    view = "left" if not views and "left" in named else next(iter(named), "")
    groups = _groups(parts, view, {*named} - {view})
    if {"y", "ry", "by"} <= groups.get(("", 0), {}).keys():
        raise ValueError("it has luminance and chroma (Y, RY, BY); write R, G and B")
    colours = list(_layers(groups, *_COLOURS))
    greys = list(_layers(groups, ("y",), without=_VECTOR))
    chosen = next((layer for layer in (*colours, *greys) if not layer.name), None)
    chosen = chosen or _beauty(colours) or _beauty(greys)
    for only in (colours, greys, list(_layers(groups, _VECTOR))):
        if chosen is None and len(only) == 1 and not (only is greys and colours):
            chosen = only[0]
    chosen = chosen or _only_channel(parts)
    if chosen is None:
        names = list(dict.fromkeys(name or "/".join(suffixes) for (name, _), suffixes in groups.items()))
        listed = ", ".join(reason_of(ValueError(name)) for name in names[:_MOST_NAMED])
        listed += " and more" if len(names) > _MOST_NAMED else ""
        raise ValueError(f"it holds the layers {listed}, but neither a default layer nor one called beauty")
    return chosen


def _only_channel(parts: Sequence[ExrPart]) -> Layer | None:
    """Return the only channel of a file, or its only one besides alpha."""
    places = [(index, k) for index, part in enumerate(parts) for k in range(len(part.channels))]
    shown = [(index, k) for index, k in places if parts[index].channels[k].lower() not in ("a", "alpha")]
    if len(places) > 2 or (len(places) == 2 and len(shown) != 1):
        return None
    return next((Layer("", index, (k,)) for index, k in (*shown, *places)), None)


def _stereo(parts: Sequence[ExrPart]) -> list[str]:
    """Return the views of a file that names none where its layers are called left and right."""
    words = {word for part in parts for name in (part.name, *part.channels) for word in name.split(".")}
    return ["left", "right"] if {"left", "right"} <= words else []


Groups = dict[tuple[str, int], dict[str, int]]
"""Indices of channels by suffix in small letters, by name of the layer and part."""


def _groups(parts: Sequence[ExrPart], view: str, hidden: set[str]) -> Groups:
    """Return the channels by layer, without those of hidden views."""
    groups: Groups = {}
    for index, part in enumerate(parts):
        if part.view in hidden:
            continue
        part_name = part.name if len(parts) > 1 else ""
        for place, channel in enumerate(part.channels):
            prefix, _, suffix = channel.rpartition(".")
            if not prefix.startswith(part_name):
                prefix = f"{part_name}.{prefix}"
            names = [name for name in (prefix or part_name).split(".") if name and name != view]
            if not hidden.intersection(names):
                groups.setdefault((".".join(names), index), {})[suffix.lower()] = place
    return groups


def _layers(groups: Groups, *kinds: tuple[str, ...], without: Iterable[str] = ()) -> Iterable[Layer]:
    """Yield the groups that have all suffixes of a kind, and not all that they shall be without."""
    excluded = set(without)
    for (name, part), places in groups.items():
        kind = next((kind for kind in kinds if places.keys() >= set(kind)), None)
        if kind is not None and not (excluded and places.keys() >= excluded):
            yield Layer(name, part, tuple(places[suffix] for suffix in kind))


def _beauty(layers: Sequence[Layer]) -> Layer | None:
    """Return the layer with the best name; one of a composite before others. None where several have it."""
    for word in BEAUTY:
        found = [layer for layer in layers if layer.name.lower().rpartition(".")[2] == word]
        found = [layer for layer in found if layer.name.lower().startswith("composite.")] or found
        if found:
            return found[0] if len({layer.name for layer in found}) == 1 else None
    return None
