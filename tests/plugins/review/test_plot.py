"""Pages of curves: readable files, the same every time."""

import numpy as np
import pytest

from flowsculpt import UsageError
from flowsculpt.pipeline.plugins.review.plot import Curves, plot_panels

FRAMES = np.linspace(1, 49, 97)
NUMBER = Curves(
    "flows.0.vortex.strength",
    "units²/s",
    FRAMES,
    np.sin(FRAMES / 9)[:, None],
    np.array([(1, 0.11), (20, 0.8)]),
)
PLACE = Curves("flows.1.wind.centre", "units", FRAMES, np.stack([FRAMES] * 3, axis=1), np.empty((0, 2)))
STILL = Curves("camera.azimuth", "degrees", FRAMES, np.zeros((97, 1)), np.empty((0, 2)))


def test_a_page_names_every_curve_with_its_unit(tmp_path):
    plot_panels("A010", [NUMBER, PLACE, STILL], 24.0, tmp_path / "a.svg")
    text = (tmp_path / "a.svg").read_text()
    assert all(f"<!-- {word} -->" in text for word in (NUMBER.name, PLACE.name, "A010", "frame"))
    plot_panels("A010", [NUMBER, PLACE, STILL], 24.0, tmp_path / "b.svg")
    assert (tmp_path / "b.svg").read_text() == text


@pytest.mark.parametrize(("ending", "begins"), [("png", b"\x89PNG"), ("pdf", b"%PDF")])
def test_the_ending_says_what_file_it_is(tmp_path, ending, begins):
    plot_panels("A010", [NUMBER], 24.0, tmp_path / f"a.{ending}")
    assert (tmp_path / f"a.{ending}").read_bytes().startswith(begins)


def test_what_cannot_be_is_told(tmp_path):
    with pytest.raises(UsageError, match=r"\.svg, \.png, \.pdf"):
        plot_panels("A", [NUMBER], 24.0, tmp_path / "a.txt")
    with pytest.raises(UsageError, match="no curves"):
        plot_panels("A", [], 24.0, tmp_path / "a.svg")
