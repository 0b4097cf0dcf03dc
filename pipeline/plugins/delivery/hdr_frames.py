"""Frames of high dynamic range: graphics at their white, and the light that a film holds."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flowsculpt.api.pictures import HDR_DISPLAYS, WorkingSpace

GRAPHICS_WHITE = 203.0
"""Nits of the white of graphics (ITU-R BT.2408-7, table 1)."""

BT2020 = WorkingSpace(
    "rec2020", "lin_rec2020_scene", (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290)
)


def hdr_graphics(picture: NDArray[np.uint16], display: str) -> NDArray[np.uint16]:
    """Return a picture (H, W, 3) for a Rec.709 movie as it looks next to HDR: its white at GRAPHICS_WHITE."""
    light = BT2020.from_rec709((picture / 65535.0) ** 2.4)
    shown = HDR_DISPLAYS[display].values(GRAPHICS_WHITE * np.maximum(light, 0.0))
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
