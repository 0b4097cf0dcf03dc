"""Frames of high dynamic range: graphics at their white, and the light that a film holds."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flowsculpt.api.pictures import HDR_DISPLAYS

Frame = NDArray[np.uint8] | NDArray[np.uint16]
"""A display frame (H, W, 3), or (H, W, 4) with coverage; uint8 counts 0 … 255, uint16 0 … 65535."""

GRAPHICS_WHITE = 203.0
"""Nits of the white of graphics (ITU-R BT.2408-7, table 1)."""


def hdr_graphics(picture: NDArray[np.uint16], display: str) -> NDArray[np.uint16]:
    """Return a picture (H, W, 3) for a Rec.709 movie as it looks next to HDR: its white at GRAPHICS_WHITE."""
    screen = HDR_DISPLAYS[display]
    light = screen.space.from_rec709((picture / 65535.0) ** 2.4)
    shown = screen.values(GRAPHICS_WHITE * np.maximum(light, 0.0))
    return np.asarray(np.rint(shown * 65535.0), dtype=np.uint16)


def content_light(frames: Iterable[NDArray[Any]]) -> tuple[int, int]:
    """Return the light of PQ frames (H, W, 3), uint16, in nits: MaxCLL and MaxFALL (CTA-861.3, annex P).

    Each pixel counts by its brightest channel. MaxCLL is the brightest of all pixels, MaxFALL the average of
    the frame with the highest average.
    """
    brightest = average = 0.0
    for frame in frames:
        nits = _nits_of_steps()[frame[..., :3].max(axis=2)]
        brightest, average = max(brightest, float(nits.max())), max(average, float(nits.mean()))
    return round(brightest), round(average)


@cache
def _nits_of_steps() -> NDArray[np.float32]:
    """Return the nits of each uint16."""
    return HDR_DISPLAYS["pq"].nits(np.arange(65536) / 65535.0).astype(np.float32)
