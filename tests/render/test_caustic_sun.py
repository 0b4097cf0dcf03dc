"""The sun as caustics see it: wider, with the same light."""

from __future__ import annotations

import numpy as np
import pytest

from flowsculpt.render.mitsuba.engine import Engine


@pytest.mark.parametrize("width", [0.0093, 0.3])
def test_the_wider_sun_gives_the_light_of_its_disc(engine: Engine, width: float) -> None:
    """The solid angle in which it is seen, times the factor on its light, is that of the disc."""
    engine.start()
    import mitsuba as mi

    from flowsculpt.render.integrator.photons import WIDTH, CausticSun

    if mi.variant() == "scalar_rgb":
        pytest.skip("the path tracer needs a compiled variant")
    middle = np.array([0.6, 0.8, 0.0])
    angles = np.linspace(-0.2, 0.2, 4001)
    towards = np.cos(angles)[:, None] * middle + np.sin(angles)[:, None] * np.array([0.0, 0.0, 1.0])
    seen, factor = CausticSun.of((0.6, 0.8, 0.0), width).widened(mi.Vector3f(towards.T), mi.Bool(True))
    on_disc = np.arccos(np.clip(np.array(seen).T @ middle, -1.0, 1.0)) <= width / 2.0
    wide = max(width, WIDTH)
    assert np.ptp(angles[on_disc]) == pytest.approx(wide, rel=0.03)
    assert np.array(factor)[on_disc].mean() == pytest.approx((width / wide) ** 2, rel=0.05)
    others, ones = CausticSun.of((0.6, 0.8, 0.0), width).widened(mi.Vector3f(towards.T), mi.Bool(False))
    assert np.allclose(np.array(others).T, towards, atol=1e-6)
    assert np.all(np.array(ones) == 1.0)
