"""A rendered frame: its AOVs as arrays, and the facts about it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Pixels = NDArray[np.float32]


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
