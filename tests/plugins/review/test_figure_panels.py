"""Pages of figures show histograms and bars over the frames of curves."""

import numpy as np

from flowsculpt.pipeline.plugins.review.figure_panels import HeatMap, StackedBars
from flowsculpt.pipeline.plugins.review.plot import Curves, plot_panels


def test_shares_and_parts_stand_over_the_same_frames_as_curves(tmp_path):
    frames = np.arange(1.0, 13.0)
    shares = np.tile(np.linspace(0.0, 1.0, 8), (12, 1))
    heat = HeatMap("edge lengths", "scene units", frames, shares, 0.1, ((0.08, "max"),), line=frames / 200)
    bars = StackedBars("changes", "a frame", frames, {"splits": frames, "collapses": -frames})
    gaps = Curves("area", "", frames, np.where(frames < 4, np.nan, frames)[:, None], np.zeros((0, 2)))
    pages = [tmp_path / name for name in ("one.svg", "other.svg")]
    for page in pages:
        plot_panels("measures", [heat, bars, gaps], 24.0, page)
    text = pages[0].read_text()
    assert text == pages[1].read_text() and all(word in text for word in ("splits", "collapses", "max"))
