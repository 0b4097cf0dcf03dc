"""Values as the data that keys are made of."""

from __future__ import annotations

import json

import numpy as np
import pytest

from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.flow import Function, Streamlines, keyed
from flowsculpt.pipeline.flow.catalogue.vortices import Vortex
from flowsculpt.pipeline.frames import FrameRate
from flowsculpt.pipeline.shot import Model
from flowsculpt.pipeline.shot.subjects import as_data


def test_a_flow_is_its_class_and_its_parameters() -> None:
    data = as_data(Streamlines(Vortex(strength=keyed((0.0, 1.0), (0.0, 2.0)))))
    assert data["is"] == "Streamlines" and data["field"]["is"] == "Vortex"
    assert data["field"]["strength"]["values"] == [[0.0], [2.0]]
    assert json.loads(json.dumps(data)) == data


def test_where_a_model_lies_is_no_part_of_it() -> None:
    assert as_data(Model("abc")) == {"is": "Model", "digest": "abc", "scale": 1.0}


def test_rates_and_numpy_numbers_have_a_form() -> None:
    assert as_data((FrameRate.of("23.976"), np.float64(0.5))) == ["24000/1001", 0.5]


def test_a_function_has_none() -> None:
    with pytest.raises(UsageError, match=r"a function .* use a flow of the catalogue"):
        as_data(Function(lambda points, time, dt: points))
