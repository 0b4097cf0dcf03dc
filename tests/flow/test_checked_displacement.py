"""A fault of one frame leaves the keys of all other frames."""

from __future__ import annotations

import json
from collections.abc import Callable

import numpy as np
import pytest

from flowsculpt.pipeline.errors import FrameError
from flowsculpt.pipeline.flow import Blend, Flow, Repeated, Sequence, Streamlines, checked_displacement, keyed
from flowsculpt.pipeline.flow.catalogue.basic import Rotation
from flowsculpt.pipeline.flow.catalogue.deformations import Stretch, Twist
from flowsculpt.pipeline.flow.catalogue.vortices import Vortex
from flowsculpt.pipeline.flow.composition import (
    Placed,
    RegionField,
    ScaledField,
    Transform,
    TransformedField,
    Within,
)
from flowsculpt.pipeline.flow.flow_map import FlowMap, FrameStep, checked_cache_data
from flowsculpt.pipeline.flow.keyframes import FormulaCurve
from flowsculpt.pipeline.flow.parameters import Number
from flowsculpt.pipeline.flow.regions import SphereRegion

POINTS = np.random.default_rng(3).uniform(-1, 1, size=(20, 3))
DT = 0.1
DIP = keyed((0.0, 0.45, 0.5, 0.6, 0.65, 1.0), (1.0, 1.0, -0.5, -0.5, 1.0, 1.0), "linear")
"""Below 0 from 0.5 to 0.6 seconds, and 1 where a step of a tenth does not touch that."""

TWIST = Twist(amount=keyed((0.0, 1.0), (0.0, 1.0)))

BROKEN: dict[str, Callable[[Number], Flow]] = {
    "a region without a size": lambda n: Streamlines(RegionField(Rotation(), SphereRegion(radius=n))),
    "the same about a map": lambda n: Within(TWIST, SphereRegion(radius=n)),
    "a frame without room": lambda n: Streamlines(TransformedField(Rotation(), Transform(scale=n))),
    "the same about another map": lambda n: Placed(TWIST, Transform(scale=n)),
    "a bad weight": lambda n: Streamlines(ScaledField(Rotation(), n)),
    "a bad blend": lambda n: Blend(Sequence(()), TWIST, n),
    "within others": lambda n: Sequence((TWIST, Repeated(Blend(TWIST, Sequence(()), n), 10.0))),
}


@pytest.mark.parametrize("broken", BROKEN.values(), ids=BROKEN)
def test_only_the_frame_that_fails_is_known_by_its_failure(broken: Callable[[Number], Flow]) -> None:
    bad, good = broken(DIP), broken(1.0)
    for number in range(10):
        time = number / 10
        data = checked_cache_data(bad, time, DT)
        assert json.dumps(data, allow_nan=False)
        if number == 5:
            assert data != checked_cache_data(good, time, DT)
            with pytest.raises(FrameError, match="frame 6: "):
                checked_displacement(bad, POINTS, time, DT, 6)
            with pytest.raises(FrameError, match="frame 6: "):
                history = FlowMap()
                history.add(FrameStep(bad, time, DT, 6))
                history.carry(POINTS)
        elif number not in (4, 6):
            assert data == checked_cache_data(good, time, DT)
            assert np.isfinite(checked_displacement(bad, POINTS, time, DT, number + 1)).all()


@pytest.mark.parametrize(
    "flow",
    [
        Streamlines(Vortex(strength=FormulaCurve(("1 / (t - 0.55)",), 24.0, 1))),
        Twist(amount=FormulaCurve(("1 / (t - 0.5)",), 24.0, 1)),
        Streamlines(Vortex(radius=FormulaCurve(("1 if t < 0.5 else 0",), 24.0, 1))),
        Streamlines(Vortex(radius=1e-110, strength=FormulaCurve(("0 if t < 0.5 else 1e99",), 24.0, 1))),
        Stretch(amount=FormulaCurve(("1 if t < 0.55 else 0",), 24.0, 1)),
    ],
    ids=lambda flow: flow.name,
)
def test_numbers_that_are_none_fail_their_frame(flow: Flow) -> None:
    """The frame has cache data, and its error names the frame."""
    assert json.dumps([checked_cache_data(flow, time, DT) for time in (0.2, 0.5)], allow_nan=False)
    assert np.isfinite(checked_displacement(flow, POINTS, 0.2, DT, 3)).all()
    with np.errstate(all="ignore"), pytest.raises(FrameError, match="frame 6: "):
        checked_displacement(flow, POINTS, 0.5, DT, 6)
    with np.errstate(all="ignore"), pytest.raises(FrameError, match="frame 6: "):
        history = FlowMap()
        history.add(FrameStep(flow, 0.5, DT, 6))
        history.carry(POINTS)


def test_rounds_without_number_have_data_too() -> None:
    flow = Repeated(TWIST, 1e-7)
    assert checked_cache_data(flow, 0.0, DT) != checked_cache_data(flow, 0.3, DT)
