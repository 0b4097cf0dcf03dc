"""Apply a view, from linear light to display values, by a baked table.

OpenColorIO computes a view exactly but slowly (over a second for 1920×1080). So it computes a table of 65³
colours once, with logarithmic axes, and pictures are looked up there. Colours of surfaces come out within one
step of 255. Pure, very bright blues and reds, where the view bends sharply, differ by up to seven.
"""

from __future__ import annotations

import math
from contextlib import suppress
from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from flowsculpt.render.base.atomic_write import atomic_write
from flowsculpt.render.base.kernel_cache import compiled
from flowsculpt.render.base.render_errors import BadInputError, MachineError
from flowsculpt.render.base.user_cache import CachedAnswer
from flowsculpt.render.post.hdr import HDR_DISPLAYS, hlg_of_nits, nits_of_pq
from flowsculpt.render.post.view import ACES, ColourView
from flowsculpt.render.scene.rgb_spaces import WORKING_SPACES

Floats = NDArray[np.float32]

DISPLAYS = ("rec709", "srgb")  # the displays for movies and for pictures on a page

_SIDE = 65
_TOE = 2.0**-6
_WHITE = 2.0**6
"""The table's axes run over log2(1 + x/toe) from 0 to this radiance, which the view shows as white."""

_HDR_WHITE = 2.0**10
"""The same for views of high dynamic range."""


def to_display(
    light: Floats, exposure: float = 0.0, display: str = "rec709", view: ColourView = ACES
) -> Floats:
    """Convert light (H, W, 3) of the view's working space to display values 0 … 1; `exposure` in stops.

    Raises BadInputError for a display that is in neither DISPLAYS nor HDR_DISPLAYS, or a view that cannot be
    computed.
    """
    lut, white = (
        (_hdr_lut(view.in_hdr(), display), _HDR_WHITE)
        if display in HDR_DISPLAYS
        else (
            _lut(view, view.display(display)),
            _WHITE,
        )
    )
    flat = np.ascontiguousarray(light, dtype=np.float32).reshape(-1, 3)
    shown = np.empty_like(flat)
    apply_lut(flat, 2.0**exposure, _TOE, white, lut, shown)
    return shown.reshape(light.shape)


class ViewTable(NamedTuple):
    """A baked view: display values (S, S, S, 3) by red, green and blue.

    Its axes run over log2(1 + x/toe) from 0 to the light `white`.
    """

    values: Floats
    toe: float
    white: float


def view_table(display: str = "rec709", view: ColourView = ACES) -> ViewTable:
    """Return the table by which `to_display` shows light, for other programs that show it.

    Raises BadInputError for a display that is not in DISPLAYS, or a view that cannot be computed.
    """
    return ViewTable(_lut(view, view.display(display)), _TOE, _WHITE)


def quantise(values: Floats, bits: int = 8) -> NDArray[Any]:
    """Round display values 0 … 1 to uint8, or to uint16 where `bits` is 16.

    Rounding is dithered by a fixed pattern of half a step, so a slow gradient shows grain instead of bands.
    Black and white keep their values.
    """
    steps = np.empty(values.shape, np.uint8 if bits <= 8 else np.uint16)
    pattern = dither_pattern(*values.shape[:2])
    flat = np.ascontiguousarray(values, dtype=np.float32).reshape(*pattern.shape, -1)
    quantise_dithered(flat, pattern, np.float32(2**bits - 1), steps.reshape(flat.shape))
    return steps


@lru_cache(maxsize=4)
def dither_pattern(height: int, width: int) -> Floats:
    """Return thresholds (H, W), strictly between 0 and 1, evenly spread among neighbours.

    Interleaved gradient noise: J. Jimenez, Next Generation Post Processing in Call of Duty: Advanced
    Warfare, SIGGRAPH 2014. It is the same in every frame, so it does not shimmer.
    """
    y, x = np.mgrid[0:height, 0:width].astype(np.float64)
    noise = 52.9829189 * ((0.06711056 * x + 0.00583715 * y) % 1.0) % 1.0
    pattern = np.asarray(np.clip(noise, 1e-3, 1.0 - 1e-3), dtype=np.float32)
    pattern.setflags(write=False)  # shared by all callers
    return pattern


def prepare() -> None:
    """Bake the table of every display and compile the kernels, so that the first picture need not wait."""
    for display in DISPLAYS:
        shown = to_display(np.zeros((1, 1, 3), np.float32), display=display)
        for bits in (8, 16):
            quantise(shown, bits)


def view_exactly(light: Floats, display: str = "rec709", view: ColourView = ACES) -> Floats:
    """Apply a view with OpenColorIO, exactly and slowly. Tables are baked with it and tested against it."""
    return _ocio_display(light, view, view.display(display))


def _ocio_display(light: Floats, view: ColourView, display: str) -> Floats:
    rec709 = WORKING_SPACES[view.working_space].to_rec709(light)
    picture = oiio.ImageBuf(np.ascontiguousarray(rec709, dtype=np.float32))
    shown = oiio.ImageBufAlgo.ociodisplay(
        picture, display, view.view, fromspace=view.space, colorconfig=view.config
    )
    if shown.has_error:
        raise BadInputError(f"OpenColorIO cannot show {view.view!r} on {display!r}: {shown.geterror()}")
    return np.asarray(shown.get_pixels(oiio.FLOAT), dtype=np.float32)


@cache
def _lut(view: ColourView, display: str) -> Floats:
    """Return the table (65, 65, 65, 3) of a view, by red, green, blue; from the user's cache, or baked."""
    recipe = f"{oiio.__version__} {sorted(view.recipe.items())} {display} {_SIDE} {_TOE} {_WHITE}"
    file = CachedAnswer.of("views", [recipe], ".npz").path
    with suppress(Exception):  # numpy and zipfile raise a dozen kinds for what is damaged
        with file.open("rb") as content, np.load(content) as stored:  # which has a checksum
            lut = stored["table"]
        if lut.shape == (_SIDE, _SIDE, _SIDE, 3) and lut.dtype == np.float32:
            return np.asarray(lut)
    lut = _bake(view, display, _WHITE)
    with suppress(MachineError), atomic_write(file, flush=False) as draft, draft.open("wb") as stream:
        np.savez(stream, table=lut)
    return lut


@cache
def _hdr_lut(view: ColourView, display: str) -> Floats:
    """Return the table (65, 65, 65, 3) of a view of PQ, in PQ or in HLG."""
    shown = _bake(view, view.movie, _HDR_WHITE)
    return shown if display == "pq" else hlg_of_nits(nits_of_pq(shown)).astype(np.float32)


def _bake(view: ColourView, display: str, white: float) -> Floats:
    axis = _TOE * (2.0 ** (np.linspace(0.0, 1.0, _SIDE) * np.log2(1.0 + white / _TOE)) - 1.0)
    red, green, blue = np.meshgrid(axis, axis, axis, indexing="ij")
    colours = np.stack([red, green, blue], axis=-1).reshape(_SIDE * _SIDE, _SIDE, 3)
    return _ocio_display(colours.astype(np.float32), view, display).reshape(_SIDE, _SIDE, _SIDE, 3)


@compiled()
def apply_lut(light: Floats, gain: float, toe: float, white: float, lut: Floats, shown: Floats) -> None:
    """Look up colours (N, 3), times `gain`, trilinearly in a table (S, S, S, 3); write to `shown` (N, 3).

    The table's axes run over log2(1 + x/toe) from 0 to `white`. Negative values and NaN count as black.
    """
    last = lut.shape[0] - 1
    steps = last / math.log2(1.0 + white / toe)
    low = np.zeros(3, np.int64)
    part = np.zeros(3)
    for i in range(light.shape[0]):
        for axis in range(3):
            x = light[i, axis] * gain
            x = min(x, white) if x > 0.0 else 0.0
            place = math.log2(1.0 + x / toe) * steps
            low[axis] = min(int(place), last - 1)
            part[axis] = place - low[axis]
        r, g, b = low
        for channel in range(3):
            total = 0.0
            for corner in range(8):
                dr, dg, db = corner >> 2, corner >> 1 & 1, corner & 1
                weight = part[0] if dr else 1.0 - part[0]
                weight *= part[1] if dg else 1.0 - part[1]
                weight *= part[2] if db else 1.0 - part[2]
                total += weight * lut[r + dr, g + dg, b + db, channel]
            shown[i, channel] = min(max(total, 0.0), 1.0)


@compiled()
def quantise_dithered(values: Floats, dither: Floats, top: np.float32, steps: NDArray[np.integer]) -> None:
    """Round values (H, W, C), 0 … 1, to steps 0 … `top`: up where the fraction is 1 - dither (H, W) or more.

    NaN counts as black.
    """
    zero, one = np.float32(0.0), np.float32(1.0)
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            for k in range(values.shape[2]):
                value = values[i, j, k] if values[i, j, k] > zero else zero
                value = (value if value < one else one) * top + dither[i, j]
                steps[i, j, k] = np.int32(value if value < top else top)
