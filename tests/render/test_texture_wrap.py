"""What is shown beyond the sides of a picture is the same in previews and in Mitsuba."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.mitsuba.engine import Engine, is_compiled
from flowsculpt.render.mitsuba.texture_coordinates import ScaledCoordinates, bitmap
from flowsculpt.render.scene.texture_projection import MODEL, TextureProjection
from flowsculpt.render.scene.textures import BLACK, CLAMP, MIRROR, REPEAT, texels_at

MODES = (REPEAT, CLAMP, MIRROR, BLACK)
PIXELS = np.random.default_rng(1).random((3, 4, 3)).astype(np.float32)
"""A picture of 4 × 3 pixels."""


@pytest.mark.parametrize("wrap", list(product(MODES, MODES)), ids="-".join)
def test_middles_of_texels_are_the_same_in_previews_and_in_mitsuba(
    engine: Engine, wrap: tuple[str, str]
) -> None:
    import drjit as dr
    import mitsuba as mi

    if not is_compiled():
        pytest.skip("needs a compiled variant, which looks up many places at once")
    across, down = np.meshgrid((np.arange(-6, 14) + 0.5) / 4, (np.arange(-5, 10) + 0.5) / 3)
    values = np.stack([across.ravel() - 0.5, 0.5 - down.ravel()], axis=1)
    projection = TextureProjection(MODEL, keeps_place=True)
    texture = mi.load_dict(bitmap(PIXELS, ScaledCoordinates(values), projection, wrap))
    places = dr.zeros(mi.SurfaceInteraction3f, len(values))
    places.uv = mi.Point2f(values.T)
    found = np.array(texture.eval_3(places)).T
    expected = texels_at(PIXELS, across.ravel(), down.ravel(), wrap)
    assert found == pytest.approx(expected, abs=2e-4)


def test_a_picture_that_repeats_thousands_of_times_beside_a_side_that_ends_is_refused(engine: Engine) -> None:
    values = np.array([[-5e6, 0.0], [5e6, 0.0]])
    with pytest.raises(BadInputError, match="repeats 10000001 times along one side"):
        bitmap(PIXELS, ScaledCoordinates(values), TextureProjection(MODEL), (REPEAT, CLAMP))


def test_places_beyond_a_picture_show_what_its_modes_say() -> None:
    row = np.arange(4.0).reshape(1, 4, 1)
    places = (np.arange(-4, 8) + 0.5) / 4
    shown = {mode: texels_at(row, places, np.full(12, 0.5), (mode, CLAMP))[:, 0].tolist() for mode in MODES}
    assert shown[REPEAT] == [0, 1, 2, 3] * 3
    assert shown[CLAMP] == [0] * 4 + [0, 1, 2, 3] + [3] * 4
    assert shown[MIRROR] == [3, 2, 1, 0, 0, 1, 2, 3, 3, 2, 1, 0]
    assert shown[BLACK] == [0] * 4 + [0, 1, 2, 3] + [0] * 4
