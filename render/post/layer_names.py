"""Channel names of layers in EXR files: our own, and those that Blender, Arnold and Nuke expect.

A layer is an array of a rendered or finished frame, such as `beauty` or `motion`. Its channels are named
`layer.letter`, but those of the beauty R, G, B and that of `alpha` A. The names of a compositor or renderer
differ in words and letters, and in the sign of motion vectors.
"""

from __future__ import annotations

from dataclasses import dataclass

from render.base.render_errors import BadInputError
from render.scene.aovs import AOVS, COMPUTED, COVERAGE
from render.scene.light_groups import PREFIX

CRYPTO = "Crypto"
"""The beginning of the names of all cryptomatte layers."""


@dataclass(frozen=True)
class Channels:
    """Channels of a layer in a file: their prefix, their last parts, and the factor on their values."""

    prefix: str
    letters: tuple[str, ...]
    factor: float = 1.0

    @property
    def names(self) -> list[str]:
        return [f"{self.prefix}.{letter}" if self.prefix else letter for letter in self.letters]


_VECTOR = "ViewLayer.Vector"
_WORDS = ("red", "green", "blue", "alpha")

_OWN_NAMES = {"beauty": Channels("", ("R", "G", "B")), "alpha": Channels("", ("A",))}

_NAMES = {
    "blender": {
        "beauty": Channels("ViewLayer.Combined", ("R", "G", "B")),
        "alpha": Channels("ViewLayer.Combined", ("A",)),
        "planar_depth": Channels("ViewLayer.Depth", ("Z",)),
        "depth": Channels("ViewLayer.Distance", ("Z",)),
        "backward_motion": Channels(_VECTOR, ("X", "Y")),
        "motion": Channels(_VECTOR, ("Z", "W"), factor=-1.0),
    },
    "arnold": {
        **_OWN_NAMES,
        "planar_depth": Channels("", ("Z",)),
        "depth": Channels("distance", ("Z",)),
        "position": Channels("P", ("X", "Y", "Z")),
        "normal": Channels("N", ("X", "Y", "Z")),
        "motion": Channels("motionvector", ("X", "Y")),
        "backward_motion": Channels("motionvector_back", ("X", "Y")),
    },
    "nuke": {
        **_OWN_NAMES,
        "planar_depth": Channels("depth", ("Z",)),
        "depth": Channels("distance", ("Z",)),
        "motion": Channels("forward", ("u", "v")),
        "backward_motion": Channels("backward", ("u", "v")),
    },
}
"""Channels by convention and layer, where they are not the layer's name and letters."""

_LETTERS = {name: aov.letters for name, aov in {**AOVS, **COMPUTED}.items()}


def channels_of(layer: str, count: int, convention: str | None = None) -> Channels:
    """Return the channels of a layer that has `count` of them.

    convention  one of `quality.CONVENTIONS`, or None for our own names

    Raises BadInputError for a layer with more channels than it has letters.
    """
    known = _NAMES[convention] if convention else _OWN_NAMES
    if layer in known:
        channels = known[layer]
    elif layer.startswith(CRYPTO):
        channels = _cryptomatte_channels(layer, convention)
    else:
        default = "A" if layer.startswith(COVERAGE) else "RGB" if layer.startswith(PREFIX) else "XYZW"
        letters = tuple(_LETTERS.get(layer, default)[:count])
        channels = Channels(_prefix(layer, convention), letters)
    if len(channels.letters) != count:
        raise BadInputError(
            f"layer {layer!r} has {count} channels; it can have up to {len(channels.letters)}"
        )
    return channels


def _prefix(layer: str, convention: str | None) -> str:
    """Return the first part of the channel names of a layer that is in no table."""
    if layer.startswith(PREFIX):
        group = layer.removeprefix(PREFIX)
        prefixes = {"blender": f"ViewLayer.Combined_{group}", "arnold": f"RGBA_{group}"}
        return prefixes.get(convention or "", layer)
    return f"ViewLayer.{layer.capitalize()}" if convention == "blender" else layer


def _cryptomatte_channels(layer: str, convention: str | None) -> Channels:
    if convention == "blender":
        return Channels(f"ViewLayer.{layer}", ("r", "g", "b", "a"))
    if convention == "arnold":
        return Channels(layer.replace(CRYPTO, "crypto_").lower(), ("R", "G", "B", "A"))
    return Channels(layer, _WORDS)


def cryptomatte_label(crypto: str, convention: str | None) -> str:
    """Return the name of a set of mattes in a file: that of its layers, without their numbers."""
    return _cryptomatte_channels(crypto, convention).prefix
