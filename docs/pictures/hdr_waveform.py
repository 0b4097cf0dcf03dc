"""Draw the waveform of an HDR movie in nits, next to the frame that it is of.

`python docs/pictures/hdr_waveform.py MOVIE --frame 40` writes docs/pictures/hdr_waveform.webp, of a movie
that `flowsculpt deliver --as hdr10` or `hdr10-av1` made.
"""

from __future__ import annotations

import argparse
import io
from itertools import islice
from pathlib import Path

import av
import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from flowsculpt.pipeline.plugins.delivery.hdr_frames import GRAPHICS_WHITE
from flowsculpt.pipeline.plugins.review.plot import INK, STYLE
from flowsculpt.render.post.hdr import PEAK, nits_of_pq, pq_of_nits

MARKS = (0.1, 1.0, 10.0, 100.0, GRAPHICS_WHITE, PEAK)
COLUMNS, ROWS = 480, 256
PENS = np.array([[1.0, 0.25, 0.2], [0.2, 0.9, 0.3], [0.25, 0.45, 1.0]])


def frame_of(movie: Path, number: int) -> NDArray[np.float64]:
    """Return the PQ values (H, W, 3), 0 … 1, of a frame, counted from 1."""
    with av.open(str(movie)) as container:
        shown = next(islice(container.decode(video=0), number - 1, None))
        planes = shown.reformat(format="yuv444p16le").to_ndarray().astype(np.float64) / 256.0
    luma, blue, red = (planes[..., 0] - 16.0) / 219.0, planes[..., 1], planes[..., 2]
    blue, red = (blue - 128.0) / 224.0, (red - 128.0) / 224.0  # BT.2020, non-constant luminance
    red, blue = luma + 1.4746 * red, luma + 1.8814 * blue
    return np.stack([red, (luma - 0.2627 * red - 0.0593 * blue) / 0.6780, blue], axis=2).clip(0.0, 1.0)


def waveform(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the picture (ROWS, COLUMNS, 3) of the values of channels in each column."""
    columns = np.broadcast_to(np.linspace(0.0, 1.0, values.shape[1]), values.shape[:2])
    drawn = np.zeros((ROWS, COLUMNS, 3))
    for channel, pen in enumerate(PENS):
        counts = np.histogram2d(
            values[..., channel].ravel(), columns.ravel(), (ROWS, COLUMNS), ((0.0, 1.0), (0.0, 1.0))
        )[0]
        drawn += (1.0 - np.exp(-6.0 * counts / counts.sum(axis=0).max()))[..., None] * pen
    return drawn.clip(0.0, 1.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("movie", type=Path)
    parser.add_argument("--frame", type=int, default=1, help="Counted from 1.")
    parser.add_argument("-o", type=Path, default=Path(__file__).parent / "hdr_waveform.webp")
    options = parser.parse_args()
    values = frame_of(options.movie, options.frame)
    nits = nits_of_pq(values)
    with plt.rc_context(STYLE):
        page, (left, right) = plt.subplots(1, 2, figsize=(11, 3.3), width_ratios=(1.0, 1.15))
        left.imshow(np.clip(nits / 400.0, 0.0, 1.0) ** (1.0 / 2.4))
        left.set_title("the frame, dimmed: 400 nits are white", fontsize=9, color=INK)
        left.axis("off")
        right.imshow(waveform(values), origin="lower", extent=(0.0, 1.0, 0.0, 1.0), aspect="auto")
        right.set_yticks(pq_of_nits(np.array(MARKS)), [f"{mark:g}" for mark in MARKS])
        right.set_ylim(0.0, 0.8)
        right.set_xticks([])
        right.grid(axis="y", color="#666a70", linewidth=0.4)
        right.set_axisbelow(False)
        right.set_title(f"nits by column; the brightest pixel has {nits.max():.0f}", fontsize=9, color=INK)
        page.tight_layout()
        drawing = io.BytesIO()
        page.savefig(drawing, dpi=110)
    Image.open(drawing).convert("RGB").save(options.o, quality=88)


if __name__ == "__main__":
    main()
