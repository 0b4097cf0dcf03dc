"""AOVs: the table of them, and a rendered frame, which holds them as arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Pixels = NDArray[np.float32]


@dataclass(frozen=True)
class Aov:
    """An AOV: the letters of its channels, their precision in a file (half or float), and its meaning."""

    letters: str
    precision: str
    meaning: str


ALWAYS = {
    "beauty": Aov("RGB", "half", "light"),
    "albedo": Aov("RGB", "half", "reflectance"),
    "normal": Aov("XYZ", "half", "shading normal"),
    "position": Aov("XYZ", "float", "position in the scene"),
    "depth": Aov("Z", "float", "distance from the lens"),
    "matte": Aov("A", "half", "coverage of the pixel by the subject"),
}
"""AOVs of every frame."""

EXTRA = {
    "velocity": Aov("XYZ", "half", "of the subject, scene units per second"),
    "motion": Aov("XY", "half", "pixels right and up from this frame to the next, as the camera sees it"),
    "before": Aov("XYZ", "half", "of the subject, to its position a frame earlier, scene units"),
    "after": Aov("XYZ", "half", "of the subject, to its position a frame later, scene units"),
    "rest": Aov("XYZ", "float", "position before any flow moved it"),
    "noise": Aov("Y", "half", "standard error of the beauty's luminance"),
    "samples": Aov("N", "float", "samples per pixel"),
}
"""AOVs of a frame that asks for them."""

AOVS = {**ALWAYS, **EXTRA}

NEEDED_BY_AOV = {
    "velocity": "velocities",
    "motion": "the next frame",
    "before": "the frame before",
    "after": "the next frame",
    "rest": "rest positions",
}
"""Vertex data that an AOV needs, in the words of messages."""

VERTEX_AOVS = tuple(NEEDED_BY_AOV)
"""AOVs that show an attribute of the subject's vertices."""


@dataclass(frozen=True, eq=False)
class RenderedFrame:
    """The AOVs of a frame as float32 arrays, (H, W, 3) or (H, W), by name.

    `facts` are the same whenever the frame is rendered; `seconds` are where the time of this rendering went.

    beauty    linear Rec.709 radiance
    albedo    reflectance, within 0 … 1
    normal    shading normal, scene axes
    position  scene units
    depth     distance from the camera, scene units
    matte     coverage of the pixel by the subject, 0 … 1

    All are means over the pixel: at the subject's outline (matte between 0 and 1) position and depth are
    between those of the subject and the stage.
    """

    arrays: Mapping[str, Pixels]
    facts: Mapping[str, Any] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Pixels:
        return self.arrays[name]

    def with_(self, **arrays: Pixels) -> RenderedFrame:
        """Return the frame with some AOVs added or replaced."""
        return RenderedFrame({**self.arrays, **arrays}, self.facts, self.seconds)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        height, width = next(iter(self.arrays.values())).shape[:2]
        return width, height
