"""The entry `stage` of a shot file, and the stage that it becomes."""

import dataclasses
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from pipeline.shot.documents.colours import Colour
from pipeline.shot.documents.fields import Document, ZeroToOne, one_of, optional, vector
from pipeline.shot.yaml.validation import finding
from render.scene.stage import STAGES, Stage


class StageDocument(Document):
    """A stage of the registry with some of its settings replaced."""

    example = "{kind: ground}"

    kind: Annotated[str, one_of(STAGES, "stage")] = Field("cyclorama", description="its name")
    colour: Colour | None = optional(
        "of floor and wall: red, green, blue from 0 to 1, linear Rec.709, or '#c04020'"
    )
    roughness: ZeroToOne | None = optional(
        "of a coat on the floor: 0.05 mirrors, 0.4 shimmers; by default matt"
    )
    width: Annotated[float, Field(ge=0.2, le=10)] | None = optional(
        "of the plinth, in half-sizes of the subject; by default 1.7"
    )
    height: Annotated[float, Field(ge=0.2, le=10)] | None = optional(
        "of the plinth, in half-sizes of the subject; by default 1.6"
    )
    round: bool | None = optional("a round plinth instead of a square one")
    plinth_colour: Colour | None = optional("of the plinth; by default a light grey")
    shadow_catcher: bool | None = optional(
        "floor and wall are not seen, but the shadows on them, as alpha: for compositing"
    )

    @model_validator(mode="after")
    def _kind_has_all(self) -> Self:
        all_settings = ("colour", "roughness", "shadow_catcher", "width", "height", "round", "plinth_colour")
        settings = dict.fromkeys(STAGES, all_settings[:3]) | {"plinth": all_settings, "none": ()}
        for name in all_settings:
            if getattr(self, name) is not None and name not in settings[self.kind]:
                fitting = " or ".join(kind for kind in STAGES if name in settings[kind])
                raise finding(
                    f"stage has {name}, which {self.kind} does not use. Remove it, or take {fitting}."
                )
        return self

    def build(self) -> Stage:
        given: dict[str, Any] = self.model_dump(
            exclude_none=True, exclude={"kind", "colour", "plinth_colour"}
        )
        colours = {"colour": self.colour, "plinth_colour": self.plinth_colour}
        given |= {name: vector(colour) for name, colour in colours.items() if colour}
        return dataclasses.replace(STAGES[self.kind], **given)
