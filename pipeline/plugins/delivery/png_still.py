"""Stills as PNG, with the cards of an edit: a poster is an edit of one frame, its title over the picture."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from itertools import islice
from pathlib import Path

import av
import numpy as np

from flowsculpt import UsageError
from flowsculpt.api.files import atomic_write
from flowsculpt.api.pictures import ENCODES, Encode
from flowsculpt.pipeline.plugins.delivery.hdr_frames import Frame

_CONTAINER = replace(ENCODES["avif"].container, format="png", suffix=".png")

PNG = Encode("png", _CONTAINER, "png", "rgb48be", {}, display="srgb")
"""PNG of 16 bits in sRGB; it holds one frame."""


def require_one_frame(name: str, frames: int) -> None:
    """Raises UsageError for more than one frame. name: of the deliverable"""
    if frames != 1:
        raise UsageError(f"{name} holds one frame, not {frames}; choose one with -f 40, or deliver avif")


def write_png(path: Path, frames: Iterator[Frame]) -> None:
    """Write the one display frame (H, W, 3). Raises as `require_one_frame`, and MachineError where the disk
    refuses.
    """
    shown = list(islice(frames, 2))
    require_one_frame(PNG.name, len(shown))
    frame = np.ascontiguousarray(shown[0][..., :3])
    sixteen = frame.astype(np.uint16) * 257 if frame.dtype == np.uint8 else frame
    coder = av.CodecContext.create("png", "w")
    coder.height, coder.width = frame.shape[:2]
    coder.pix_fmt, coder.time_base = PNG.pixel_format, Fraction(1, 1)
    picture = av.VideoFrame.from_ndarray(sixteen, format="rgb48le").reformat(format=PNG.pixel_format)
    packets = [*coder.encode(picture), *coder.encode(None)]
    with atomic_write(path) as draft:
        draft.write_bytes(b"".join(bytes(packet) for packet in packets))
