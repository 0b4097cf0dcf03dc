"""The entry `breed: {ancestry: …}` of bred shots."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from flowsculpt.api.shots import Document


class AncestryDocument(Document):
    """The origin of a bred shot; no picture depends on it."""

    parents: list[str] = Field(min_length=1, max_length=2, description="the shot that it is made of, or two")
    ancestors: list[str] = Field(
        default_factory=list, description="all shots before its parents, oldest first"
    )
    generation: Annotated[int, Field(ge=1)] = Field(description="1 for children of shots that were not bred")
    candidate: Annotated[int, Field(ge=1)] = Field(description="its number among the candidates")
    seed: int = Field(description="another one, other children")
    change: Annotated[float, Field(ge=0, le=1)] = Field(description="how far children go from their parents")
