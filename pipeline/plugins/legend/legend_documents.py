"""The entries of a shot file for legends: `legend: {colours: {}, clock: {}, scale: {}}`."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from flowsculpt import UsageError
from flowsculpt.api.shots import Document

Corner = Literal["lower left", "lower right", "upper left", "upper right"]


class PartDocument(Document):
    """Settings that all parts of a legend have."""

    place: Corner = Field("lower left", description="the corner; parts in one stand above one another")
    size: float = Field(1.0, ge=0.4, le=4, description="factor on the size of letters and lines")
    ink: Literal["light", "dark"] | None = Field(
        None, description="of letters and lines; by default what reads on the stage"
    )


class ColoursDocument(PartDocument):
    """The palette of the look, with what it shows and its range."""

    label: str | None = Field(
        None, max_length=60, description="what it shows; by default the data's own name"
    )
    unit: str | None = Field(None, max_length=20, description="by default the data's own")

    def check_shot(self, shot: Any) -> None:
        if not any(hasattr(part.picture.look.pattern, "range") for part in shot.parts):
            raise UsageError(
                "colours needs a look with a measure, and none of this shot has one. Write look: {material: "
                "clay, measure: {speed: {}}}, or leave colours out."
            )


class ClockDocument(PartDocument):
    """The date of the data, or the seconds of the flow where the data have none."""

    place: Corner = Field("lower right", description="the corner; parts in one stand above one another")


class ScaleBarDocument(PartDocument):
    """A round length, as long as it is where the camera looks."""

    place: Corner = Field("lower right", description="the corner; parts in one stand above one another")
    unit: str = Field("units", max_length=20, description="of lengths in a scene whose data do not say it")
