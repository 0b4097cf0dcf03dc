"""Stills as JPEG with a gain map (ISO 21496-1): any viewer shows the picture, HDR screens its highlights."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from dataclasses import replace
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flowsculpt import MachineError
from flowsculpt.api.files import atomic_write, python_command
from flowsculpt.api.pictures import ENCODES, HDR_DISPLAYS, Encode
from flowsculpt.pipeline.plugins.delivery.hdr_frames import GRAPHICS_WHITE, Frame
from flowsculpt.pipeline.plugins.delivery.png_still import require_one_frame

_AVIF, _PQ = ENCODES["avif"], HDR_DISPLAYS["pq"]

GAIN_MAP = replace(
    _AVIF,
    name="gain-map",
    container=replace(_AVIF.container, format="gain-map", suffix=".jpg"),
    codec="libultrahdr",
)
"""JPEG with a gain map, made of frames in PQ; it holds one frame."""

_P3 = replace(
    _PQ.space,
    name="p3",
    interop_id="lin_p3d65_scene",
    chromaticities=(0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.3127, 0.3290),
)
"""P3 with the white D65 (SMPTE EG 432-1)."""

_QUALITY = 95  # of JPEG, for the picture and its map


def is_gain_map(encode: Encode) -> bool:
    """Tell whether files of an encode are JPEGs with a gain map."""
    return encode.container == GAIN_MAP.container


def require_gain_maps(frames: int) -> None:
    """Raises UsageError for more than one frame, MachineError where imagecodecs is not installed."""
    require_one_frame(GAIN_MAP.name, frames)
    if not _is_installed():
        raise MachineError(
            "gain-map needs the package imagecodecs (79 MB), which is not installed; install the extra "
            "[gain-maps], or only the package, for the Python of flowsculpt: "
            f"{shlex.join(python_command('pip', 'install', 'imagecodecs'))}"
        )


def _is_installed() -> bool:
    try:
        return find_spec("imagecodecs") is not None
    except ValueError:  # imported already, and without a specification
        return False


def write_gain_map(path: Path, frames: Iterator[Frame]) -> None:
    """Write the one frame (H, W, 3), uint16 in PQ of BT.2020, as JPEG in Display P3.

    White of graphics, GRAPHICS_WHITE nits, is the white of the picture. libultrahdr maps brighter light into
    the picture, and says by the map how much brighter it was. Raises as `require_gain_maps`, and MachineError
    where the disk refuses.
    """
    shown = list(islice(frames, 2))
    require_gain_maps(len(shown))
    content = _encode(shown[0][..., :3])
    with atomic_write(path) as draft:
        draft.write_bytes(content)


def _encode(frame: NDArray[Any]) -> bytes:
    import imagecodecs  # takes a second, and is an extra

    light = _P3.from_rec709(_PQ.space.to_rec709(_PQ.nits(frame / 65535.0)))
    pixels = np.ones((*frame.shape[:2], 4), np.float16)
    pixels[..., :3] = np.clip(light, 0.0, _PQ.peak) / GRAPHICS_WHITE
    kinds = imagecodecs.ULTRAHDR
    return bytes(
        imagecodecs.ultrahdr_encode(
            pixels,
            _QUALITY,
            gamut=kinds.CG.DISPLAY_P3,
            transfer=kinds.CT.LINEAR,
            nits=_PQ.peak,
            usage=kinds.USAGE.QUALITY,
        )
    )
