"""The motion that tests of the frame loop move."""

from __future__ import annotations

import pytest

from flowsculpt.pipeline.flow import Sequence, Streamlines, Sum, keyed
from flowsculpt.pipeline.flow.catalogue.deformations import Twist
from flowsculpt.pipeline.flow.catalogue.vortices import Vortex
from flowsculpt.pipeline.frames import FrameRange, FrameRate
from flowsculpt.pipeline.resample import Thresholds
from flowsculpt.pipeline.shot import Motion, Resampling, Solid
from tests.animation.motions import EDGE


@pytest.fixture
def motion() -> Motion:
    pair = Sum((Vortex(centre=(0.9, 0.0, 0.0), strength=3.0), Vortex(centre=(-0.9, 0.0, 0.0), strength=-3.0)))
    return Motion(
        frames=FrameRange.parse("5-24"),
        rate=FrameRate.of(24),
        subject=Solid.of("box", {}),
        flow=Sequence((Streamlines(pair), Twist(amount=keyed((0.0, 0.7), (0.0, 1.0))))),
        resampling=Resampling(Thresholds(max_edge_length=EDGE)),
    )
