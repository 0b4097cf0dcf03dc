"""Names in EXR files: channels of layers, and standard attributes: windows, camera, frame rate and timecode.

A layer is an array of a rendered or finished frame, such as `beauty` or `motion`. Our channels are named
`layer.letter`, except those of the beauty, R, G, B, and that of `alpha`, A. The names that Blender, Arnold
and Nuke expect differ in words and letters, and in the sign of motion vectors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.scene.aovs import AOVS, COMPUTED, COVERAGE
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.scene_lights import PREFIX

CRYPTO = "Crypto"  # the beginning of the names of all cryptomatte layers


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


MOST_FRAME_DIGITS = 40  # frames that a timeCode can count within a second: its tens have two bits


@dataclass(frozen=True)
class ExrAttributes:
    """Attributes of the OpenEXR standard that describe one picture.

    whole     width and height of the whole picture, the display window; None for that of the pixels
    corner    upper left pixel of the data window in it, where the file holds a crop
    camera    gives `worldToCamera`; a perspective one `worldToNDC`, and a spherical one `envmap` where the
              file holds the whole picture; or None
    rate      frames per second, or None
    timecode  HH:MM:SS:FF, or empty
    """

    whole: tuple[int, int] | None = None
    corner: tuple[int, int] = (0, 0)
    camera: Camera | None = None
    rate: Fraction | None = None
    timecode: str = ""

    def entries(self, size: tuple[int, int]) -> dict[str, Any]:
        """Return the header entries of a file with the pixels (width, height) of `size`, by name."""
        whole, corner = np.array(self.whole or size, np.int32), np.array(self.corner, np.int32)
        entries: dict[str, Any] = {
            "displayWindow": (np.zeros(2, np.int32), whole - 1),
            "dataWindow": (corner, corner + np.array(size, np.int32) - 1),
        }
        if self.rate is not None:
            entries["framesPerSecond"] = self.rate
        if self.timecode and int(self.timecode[-2:]) < MOST_FRAME_DIGITS:
            entries["timeCode"] = OpenEXR.TimeCode(*map(int, self.timecode.split(":")), *[0] * 14)
        if self.camera is not None:
            camera = self.camera
            entries["worldToCamera"] = world_to_camera(camera).astype(np.float32)
            if not camera.projection.is_wide:
                aspect = float(whole[0] / whole[1])
                entries["worldToNDC"] = world_to_ndc(camera, aspect).astype(np.float32)
            if camera.projection.kind == "spherical" and tuple(whole) == size:
                entries["envmap"] = OpenEXR.ENVMAP_LATLONG
        return entries


def world_to_camera(camera: Camera) -> NDArray[np.float64]:
    """Return the matrix (4, 4) that takes row vectors to right, up and forward of the camera."""
    matrix = np.eye(4)
    matrix[:3, :3] = camera.axes().T
    matrix[3, :3] = -np.asarray(camera.origin) @ matrix[:3, :3]
    return matrix


def world_to_ndc(camera: Camera, aspect: float) -> NDArray[np.float64]:
    """Return the matrix (4, 4) that takes row vectors, after division by w, to the picture.

    (0, 0) is its upper left corner and (1, 1) its lower right, as in OpenEXR and RenderMan.
    """
    half_width = math.tan(camera.field_of_view / 2.0)
    to_far = camera.far / (camera.far - camera.near)
    projection = np.array(
        [
            [0.5 / half_width, 0.0, 0.0, 0.0],
            [0.0, -0.5 * aspect / half_width, 0.0, 0.0],
            [0.5, 0.5, to_far, 1.0],
            [0.0, 0.0, -camera.near * to_far, 0.0],
        ]
    )
    return world_to_camera(camera) @ projection
