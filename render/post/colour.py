"""From linear light to a display: a view by a baked table. One of three rooms that know OpenImageIO.

OpenColorIO computes a view exactly but slowly (over a second for 1920×1080), so it is asked once, on a
cube of 65³ colours, and pictures are looked up in it. The cube's axes are logarithmic. What surfaces
reflect comes out within one step of 255; only pure, very bright blues and reds beyond any paint, where the
view folds sharply, differ by up to seven.
"""

from __future__ import annotations

import hashlib
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import platformdirs
from numpy.typing import NDArray

from render.base.atomic_write import atomic_write
from render.base.errors import BadInputError, MachineError
from render.post.dither import dither_pattern
from render.post.kernels.view import look_up, round_by
from render.post.view import ACES, ColourView

DISPLAYS = ("rec709", "srgb")
"""For movies, and for pictures on a page."""

_SIDE = 65
_TOE = 2.0**-6
_BRIGHTEST = 2.0**6
"""Axes run over log2(1 + x/toe) from 0 to this radiance, which the view shows as white."""


def to_display(
    light: NDArray[np.float32], exposure: float = 0.0, display: str = "rec709", view: ColourView = ACES
) -> NDArray[np.float32]:
    """Linear Rec.709 (H, W, 3) as display values 0 … 1 of the same shape; `exposure` in stops.

    Raises BadInputError for a display that is not one of DISPLAYS, or a view that cannot be computed.
    """
    cube = _cube(view, view.display(display))
    flat = np.ascontiguousarray(light, dtype=np.float32).reshape(-1, 3)
    shown = np.empty_like(flat)
    look_up(flat, 2.0**exposure, _TOE, _BRIGHTEST, cube, shown)
    return shown.reshape(light.shape)


def quantise(values: NDArray[np.float32], bits: int = 8) -> NDArray[Any]:
    """Display values 0 … 1 as uint8, or as uint16 where `bits` is 16.

    Rounding is dithered by a fixed pattern of half a step, so a slow gradient breaks up into grain
    instead of bands; black and white stay what they are.
    """
    steps = np.empty(values.shape, np.uint8 if bits <= 8 else np.uint16)
    noise = dither_pattern(*values.shape[:2])
    flat = np.ascontiguousarray(values, dtype=np.float32).reshape(*noise.shape, -1)
    round_by(flat, noise, np.float32(2**bits - 1), steps.reshape(flat.shape))
    return steps


def prepare() -> None:
    """Bake every display's cube and compile the kernels, so that the first picture need not wait for it."""
    for display in DISPLAYS:
        shown = to_display(np.zeros((1, 1, 3), np.float32), display=display)
        for bits in (8, 16):
            quantise(shown, bits)


def view_exactly(
    light: NDArray[np.float32], display: str = "rec709", view: ColourView = ACES
) -> NDArray[np.float32]:
    """A view as OpenColorIO computes it, slowly; cubes are baked with it and tested against it."""
    return _shown(light, view, view.display(display))


def _shown(light: NDArray[np.float32], view: ColourView, display: str) -> NDArray[np.float32]:
    picture = oiio.ImageBuf(np.ascontiguousarray(light, dtype=np.float32))
    shown = oiio.ImageBufAlgo.ociodisplay(
        picture, display, view.view, fromspace=view.space, colorconfig=view.config
    )
    if shown.has_error:
        raise BadInputError(f"OpenColorIO cannot show {view.view!r} on {display!r}: {shown.geterror()}")
    return np.asarray(shown.get_pixels(oiio.FLOAT), dtype=np.float32)


@cache
def _cube(view: ColourView, display: str) -> NDArray[np.float32]:
    """The baked cube (65, 65, 65, 3), indexed by red, green, blue; kept in the user's cache."""
    recipe = f"{oiio.__version__} {sorted(view.recipe.items())} {display} {_SIDE} {_TOE} {_BRIGHTEST}"
    name = hashlib.blake2b(recipe.encode(), digest_size=12).hexdigest()
    file = platformdirs.user_cache_path("flowsculpt") / "views" / f"{name}.npy"
    try:
        cube = np.load(file)
        if cube.shape == (_SIDE, _SIDE, _SIDE, 3) and cube.dtype == np.float32:
            return np.asarray(cube)
    except (OSError, ValueError, EOFError):
        pass
    cube = _bake(view, display)
    _keep(file, cube)
    return cube


def _bake(view: ColourView, display: str) -> NDArray[np.float32]:
    axis = _TOE * (2.0 ** (np.linspace(0.0, 1.0, _SIDE) * np.log2(1.0 + _BRIGHTEST / _TOE)) - 1.0)
    red, green, blue = np.meshgrid(axis, axis, axis, indexing="ij")
    colours = np.stack([red, green, blue], axis=-1).reshape(_SIDE * _SIDE, _SIDE, 3)
    return _shown(colours.astype(np.float32), view, display).reshape(_SIDE, _SIDE, _SIDE, 3)


def _keep(file: Path, cube: NDArray[np.float32]) -> None:
    """Store the cube; a cache that cannot be written only means to bake again."""
    with suppress(MachineError), atomic_write(file, flush=False) as draft, draft.open("wb") as stream:
        np.save(stream, cube)
