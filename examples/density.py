"""Density over 500 frames (P10): edge lengths with and without resampling."""

from __future__ import annotations

import numpy as np

from examples.drawing import COOL, INK, WARM, page, save
from examples.film import displace_film, edge_lengths, resample_film
from flowsculpt.pipeline.arrays import Floats
from flowsculpt.pipeline.flow import Flow, Streamlines, Sum
from flowsculpt.pipeline.flow.catalogue.vortices import Vortex
from flowsculpt.pipeline.mesh import icosphere
from flowsculpt.pipeline.resample import Resampler, Thresholds

FRAMES, LONGEST = 500, 0.16
SUBJECT = icosphere(12)
RATIOS = np.geomspace(1 / 40, 40, 81)
"""Borders of the histogram: edge lengths over the maximum."""


def vortex_flow(strength: float = 1.1) -> Flow:
    """Return two crossing vortices, which stretch the surface between them to ever longer bands."""
    across = Vortex(axis=(1.0, 0.0, 0.0), centre=(0.0, 0.5, 0.2), radius=0.6, strength=-strength)
    return Streamlines(Sum((Vortex(centre=(0.4, 0.0, 0.0), radius=0.7, strength=strength), across)))


def histograms(frames: int = FRAMES) -> tuple[Floats, Floats, list[int]]:
    """Return shares of the edges by length (frames + 1, 80), without and with; and the vertex counts."""
    flow, resampler = vortex_flow(), Resampler(SUBJECT, Thresholds(LONGEST))
    moved = displace_film(SUBJECT.vertices, flow, frames)
    static = [_shares(edge_lengths(SUBJECT.with_vertices(points))) for points in moved]
    adaptive, counts = [], []
    for report in resample_film(resampler, flow, frames):
        adaptive.append(_shares(edge_lengths(resampler.mesh)))
        counts.append(report.vertices)
    return np.array(static), np.array(adaptive), counts


def _shares(lengths: Floats) -> Floats:
    counted, _ = np.histogram(lengths / LONGEST, RATIOS)
    return counted / len(lengths)


def draw() -> None:
    from matplotlib.colors import LinearSegmentedColormap

    *both, counts = histograms()
    titles = (f"without resampling: {counts[0]} vertices", f"with: {counts[0]} to {counts[-1]} vertices")
    figure, panels = page(titles, height=3.3)
    for panel, rows, colour in zip(panels, both, (WARM, COOL), strict=True):
        shade = LinearSegmentedColormap.from_list("shade", ["#ffffff", colour, INK])
        panel.pcolormesh(
            np.arange(len(rows) + 1), RATIOS, np.sqrt(rows.T), cmap=shade, vmin=0, vmax=0.55, rasterized=True
        )
        panel.set(yscale="log", xlabel="frame", ylim=(1 / 40, 40))
        panel.set_yticks([0.1, 0.4, 1, 10], ["0.1", "0.4", "1", "10"])
        panel.minorticks_off()
        panel.grid(visible=False)
        for limit in (0.4, 1.0):
            panel.axhline(limit, color=INK, linewidth=0.6, dashes=(5, 3))
    panels[0].set_ylabel("edge length / maximum")
    save(figure, "density.png")


if __name__ == "__main__":
    draw()
