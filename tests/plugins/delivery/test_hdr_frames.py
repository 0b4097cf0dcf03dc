"""Graphics next to HDR pictures have their white, and the light of a film is measured in nits."""

from __future__ import annotations

import numpy as np
import pytest

from flowsculpt.pipeline.plugins.delivery.hdr_frames import GRAPHICS_WHITE, content_light, hdr_graphics
from flowsculpt.render.post.hdr import HDR_DISPLAYS, pq_of_nits


@pytest.mark.parametrize("display", HDR_DISPLAYS)
def test_white_of_graphics_is_that_of_the_recommendation(display: str) -> None:
    card = np.zeros((2, 2, 3), np.uint16)
    card[0] = 65535
    shown = HDR_DISPLAYS[display].nits(hdr_graphics(card, display) / 65535.0)
    assert shown[0] == pytest.approx(GRAPHICS_WHITE, rel=1e-3)
    assert shown[1] == pytest.approx(0.0, abs=1e-3)


def test_the_light_of_a_film_is_its_brightest_pixel_and_its_brightest_frame() -> None:
    nits = np.full((2, 4, 4, 3), 50.0)
    nits[1, :2] = (200.0, 900.0, 10.0)
    frames = np.rint(65535.0 * pq_of_nits(nits)).astype(np.uint16)
    assert content_light(frames) == (900, 475)
