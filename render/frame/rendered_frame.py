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
    """A picture's named float32 arrays, (H, W, 3) or (H, W), and the facts about it.

    `facts` are the same whenever the same frame is rendered; `seconds` say where this rendering's time
    went.

    beauty    linear Rec.709 radiance
    albedo    reflectance, within 0 … 1
    normal    shading normal, scene axes
    position  scene units
    depth     distance from the camera, scene units
    matte     how much of the pixel the subject covers, 0 … 1

    All are averages over the pixel, so at the subject's outline (matte between 0 and 1) position and
    depth lie between the subject's and the stage's.
    """

    arrays: Mapping[str, Pixels]
    facts: Mapping[str, Any] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Pixels:
        return self.arrays[name]

    def with_(self, **arrays: Pixels) -> RenderedFrame:
        """The same picture with some layers added or replaced."""
        return RenderedFrame({**self.arrays, **arrays}, self.facts, self.seconds)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        height, width = next(iter(self.arrays.values())).shape[:2]
        return width, height
