"""The entry `smooth` of a shot file: into how many pieces curved patches are cut."""

from __future__ import annotations

import re
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, model_validator
from pydantic_core import PydanticCustomError

from pipeline.mesh.pn_triangles import MOST_PIECES
from pipeline.shot.documents.fields import Document, Told

_PIXELS = r"^\s*(\d+\.?\d*|\.\d+)\s*px\s*$"


def _pixels(value: Any) -> Any:
    """`2px` as 2.0."""
    if not isinstance(value, str):
        return value
    match = re.match(_PIXELS, value)
    if not match:
        raise PydanticCustomError(
            "pixels", "{text} is no length in pixels. Write 2px.", {"text": repr(value)}
        )
    return float(match[1])


Pixels = Annotated[
    float,
    BeforeValidator(_pixels),
    Field(ge=0.25, le=1000),
    Told(type=["number", "string"], pattern=_PIXELS),
]


class SmoothDocument(Document):
    """Pieces of each edge by their number, or by how long they are in the picture."""

    tessellate: Annotated[int, Field(ge=1, le=MOST_PIECES)] | None = None
    dicing: Pixels | None = None

    @model_validator(mode="after")
    def _says_one(self) -> SmoothDocument:
        if self.tessellate is not None and self.dicing is not None:
            raise PydanticCustomError(
                "two_measures",
                "two measures: tessellate, a number of pieces, and dicing, how long they are in the picture. "
                "Remove one of them.",
            )
        return self
