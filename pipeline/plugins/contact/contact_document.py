"""The entry `contact` of flows in a shot file."""

from typing import Annotated, Any, Self

from pydantic import model_validator

from flowsculpt.api.flows import ParameterDoc
from flowsculpt.api.shots import ByForm, Changing, Clock, FlowParameters, NumberField, Triple
from flowsculpt.pipeline.plugins.contact.contact_flow import Contact


class ContactDocument(FlowParameters):
    """A floor and other subjects, and how soft the subject is."""

    flow = Contact
    example = "{floor: true, softness: 1}"

    floor: Annotated[
        Annotated[bool | NumberField, ByForm(lambda value: 0 if isinstance(value, bool) else 1)] | None,
        ParameterDoc(
            "its height, or true for that of the lowest point at the start; true without others",
            "units",
        ),
    ] = None
    others: Annotated[
        list[str] | None, ParameterDoc("names of subjects of the shot that it gives way to")
    ] = None
    side: Annotated[
        Triple | None,
        ParameterDoc("direction from the others to it; by default that of the widest gap in the first frame"),
    ] = None

    @model_validator(mode="after")
    def _meets_something(self) -> Self:
        if self.floor is False and not self.others:
            raise ValueError("contact needs a floor or others. Write floor: true.")
        if self.side is not None and not any(self.side):
            raise ValueError("side has no direction. Write side: [0, 1, 0] for above the others.")
        return self

    def build(self, clock: Clock) -> Any:
        """Return the flow itself: its steps are those of other flows, which plans look into."""
        return super().build(clock).plugin_flow

    def own_values(self, clock: Clock) -> dict[str, Any]:
        """Return the floor, the others, and the time of each frame."""
        floor = self.floor.curve(clock) if isinstance(self.floor, Changing) else self.floor
        times = tuple(clock.flow_time(frame) for frame in clock.frames)
        has_floor = not self.others if floor is None else floor is not False
        return {
            "floor": None if isinstance(floor, bool) else floor,
            "has_floor": has_floor,
            "others": tuple(dict.fromkeys(self.others or ())),
            "side": None if self.side is None else tuple(float(x) for x in self.side),
            "times": times,
        }
