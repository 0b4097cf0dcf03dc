"""High dynamic range: the curves of ITU-R BT.2100.

Display values count nits (cd/m²) by the perceptual quantiser, PQ, or relate to the scene by hybrid log-gamma,
HLG, on a display of PEAK nits. Primaries are those of BT.2020.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.scene.rgb_spaces import WorkingSpace

BT2020 = WorkingSpace(
    "rec2020", "lin_rec2020_scene", (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290)
)

PEAK = 1000.0
"""Nits of the display that views are made for, and that frames are mastered on."""

_LUMA = np.array([0.2627, 0.6780, 0.0593])  # ITU-R BT.2020-2, table 4
_M1, _M2 = 2610 / 16384, 2523 / 4096 * 128  # ITU-R BT.2100-2, table 4
_C1, _C2, _C3 = 3424 / 4096, 2413 / 4096 * 32, 2392 / 4096 * 32
_A = 0.17883277  # ITU-R BT.2100-2, table 5
_B = 1.0 - 4.0 * _A
_C = 0.5 - _A * np.log(4.0 * _A)
_SYSTEM_GAMMA = 1.2  # of a display of 1000 nits

Values = NDArray[Any]


def nits_of_pq(values: Values) -> Values:
    """Return the nits of PQ display values 0 … 1."""
    root = np.clip(values, 0.0, 1.0) ** (1.0 / _M2)
    return 10000.0 * (np.maximum(root - _C1, 0.0) / (_C2 - _C3 * root)) ** (1.0 / _M1)


def pq_of_nits(nits: Values) -> Values:
    """Return the PQ display values 0 … 1 of nits."""
    power = (np.clip(nits, 0.0, 10000.0) / 10000.0) ** _M1
    return ((_C1 + _C2 * power) / (1.0 + _C3 * power)) ** _M2


def hlg_of_nits(nits: Values) -> Values:
    """Return the HLG display values 0 … 1 that show nits (…, 3) of BT.2020 on a display of PEAK nits."""
    shown = np.clip(nits / PEAK, 0.0, 1.0)
    luminance = np.maximum(shown @ _LUMA, 1e-12)[..., None]
    scene = np.clip(shown * luminance ** (1.0 / _SYSTEM_GAMMA - 1.0), 0.0, 1.0)
    bright = _A * np.log(np.maximum(12.0 * scene - _B, 1e-12)) + _C
    return np.where(scene <= 1.0 / 12.0, np.sqrt(3.0 * scene), bright)


def nits_of_hlg(values: Values) -> Values:
    """Return the nits (…, 3) of BT.2020 that HLG display values show on a display of PEAK nits."""
    clipped = np.clip(values, 0.0, 1.0)
    scene = np.where(clipped <= 0.5, clipped**2 / 3.0, (np.exp((clipped - _C) / _A) + _B) / 12.0)
    luminance = np.maximum(scene @ _LUMA, 1e-12)[..., None]
    return PEAK * scene * luminance ** (_SYSTEM_GAMMA - 1.0)


class HdrDisplay(NamedTuple):
    """A display of high dynamic range.

    values  turns nits (…, 3) of BT.2020 into display values 0 … 1
    nits    turns display values back into nits
    peak    its brightest white, nits
    space   its primaries
    """

    values: Callable[[Values], Values]
    nits: Callable[[Values], Values]
    peak: float = PEAK
    space: WorkingSpace = BT2020


HDR_DISPLAYS = {"pq": HdrDisplay(pq_of_nits, nits_of_pq), "hlg": HdrDisplay(hlg_of_nits, nits_of_hlg)}
"""Displays of high dynamic range by the names that `PictureDisplay` knows them by."""
