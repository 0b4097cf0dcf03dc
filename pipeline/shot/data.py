"""Values as JSON-able data, which keys are hashed from. Equal values give equal data on every machine."""

from __future__ import annotations

import dataclasses
from fractions import Fraction
from typing import Any

import numpy as np

from pipeline.errors import UsageError
from pipeline.frames import FrameRange, FrameRate

NOT_DATA = {"as_data": False}
"""`field(metadata=NOT_DATA)`: a field that changes no result, and stands in no key."""


def as_data(value: Any) -> Any:
    """Return dataclasses as dicts with their class under `is`, tuples as lists, numbers and text unchanged.

    Fields that a dataclass computes from others (`init=False`) are left out.

    Raises UsageError for a value without such a form, a Python function for one.
    """
    if value is None or isinstance(value, str | bool | int | float):
        return value
    if isinstance(value, np.integer | np.floating):
        return value.item()
    if isinstance(value, FrameRange | FrameRate | Fraction):
        return str(value)
    if isinstance(value, tuple | list):
        return [as_data(item) for item in value]
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = [f for f in dataclasses.fields(value) if f.init and f.metadata.get("as_data", True)]
        return {"is": type(value).__name__, **{f.name: as_data(getattr(value, f.name)) for f in fields}}
    kind = "function" if callable(value) else type(value).__name__
    raise UsageError(f"a {kind} ({value!r}) cannot stand in a shot's data; use a flow of the catalogue")
