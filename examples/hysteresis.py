"""The hysteresis of two thresholds (P11, P12): close ones thrash, wide ones let lengths spread."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from examples.density import LONGEST, SUBJECT, vortex_flow
from examples.drawing import COOL, INK, WARM, dots, page, save
from examples.film import edge_lengths, resample_film
from flowsculpt.pipeline.resample import Resampler, Thresholds
from flowsculpt.pipeline.resample.thresholds import DEFAULT_RATIO

FRAMES = 240
RATIOS = (0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.49)


class Film(NamedTuple):
    """Cost and result of one ratio, over the second half of its frames.

    Splits and collapses a frame for 1000 edges; standard deviation of the edge lengths over their mean.
    """

    operations: float
    spread: float


def film(ratio: float, frames: int = FRAMES) -> Film:
    """Resample a ball in two vortices with this ratio of minimum to maximum."""
    resampler = Resampler(SUBJECT, Thresholds(LONGEST, ratio * LONGEST))
    work, spread = [], []
    for frame, report in enumerate(resample_film(resampler, vortex_flow(), frames)):
        if frame > frames // 2:
            lengths = edge_lengths(resampler.mesh)
            work.append(1000 * (report.splits + report.collapses) / report.edges)
            spread.append(lengths.std() / lengths.mean())
    return Film(float(np.mean(work)), float(np.mean(spread)))


def draw() -> None:
    films = np.array([film(ratio) for ratio in RATIOS])
    figure, (curve,) = page(("each point a ratio of minimum to maximum",), height=3.4)
    curve.plot(films[:, 1], films[:, 0], color=COOL, zorder=2)
    dots(curve, films[:, ::-1], COOL)
    for ratio, point in zip(RATIOS, films[:, ::-1], strict=True):
        usual, below = ratio == DEFAULT_RATIO, ratio == RATIOS[0]
        name, colour = (f"{ratio}, the usual one", WARM) if usual else (f"{ratio}", INK)
        place = (-4, -15) if below else (8, 5)
        curve.annotate(name, point, place, textcoords="offset points", color=colour)
    curve.set(
        xlabel="spread of edge lengths (standard deviation / mean)",
        ylabel="operations a frame, for 1000 edges",
    )
    curve.set_ylim(0, 9)
    save(figure, "hysteresis.svg")


if __name__ == "__main__":
    draw()
