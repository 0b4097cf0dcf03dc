"""The stage `marbling.mist`, between `render` and `finish`, and its entry in shot files."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from pydantic import Field

from flowsculpt.api.pictures import RenderedFrame
from flowsculpt.api.shots import Document


class Mist(Document):
    """Mist that swallows what is far from the camera."""

    density: float = Field(
        0.05, gt=0, le=10, description="share of the light that is lost per unit of distance"
    )
    start: float = Field(0.0, ge=0, description="distance from the camera where it begins (units)")
    colour: list[float] = Field(
        [0.05, 0.06, 0.08], min_length=3, max_length=3, description="linear Rec.709 radiance"
    )


def add_mist(frame: RenderedFrame, mist: Mist, number: int) -> RenderedFrame:
    """Return a frame whose light is lost, and replaced by that of the mist, along each ray (Beer–Lambert)."""
    depth = np.maximum(frame["depth"].reshape(*frame["beauty"].shape[:2], 1) - mist.start, 0.0)
    left = np.exp(-mist.density * np.nan_to_num(depth, posinf=1e6))
    light = left * frame["beauty"] + (1.0 - left) * frame["alpha"][..., None] * np.float32(mist.colour)
    return replace(frame, arrays={**frame.arrays, "beauty": light.astype(np.float32)})
