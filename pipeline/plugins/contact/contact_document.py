"""The entry `contact` of flows in a shot file."""

from typing import Annotated, Any, Literal

from flowsculpt.api.flows import ParameterDoc
from flowsculpt.api.shots import ByForm, Changing, Clock, FlowParameters, NumberField
from flowsculpt.pipeline.plugins.contact.contact_flow import Contact


class ContactDocument(FlowParameters):
    """A floor, and how soft the subject is."""

    flow = Contact
    example = "{floor: true, softness: 1}"

    floor: Annotated[
        Annotated[Literal[True] | NumberField, ByForm(lambda value: 0 if value is True else 1)],
        ParameterDoc("its height, or true for that of the lowest point in the first frame", "units"),
    ] = True

    def build(self, clock: Clock) -> Any:
        """Return the flow itself: its steps are those of other flows, which plans look into."""
        return super().build(clock).plugin_flow

    def own_values(self, clock: Clock) -> dict[str, Any]:
        """Return the floor, and the time of each frame."""
        floor = self.floor.curve(clock) if isinstance(self.floor, Changing) else self.floor
        times = tuple(clock.flow_time(frame) for frame in clock.frames)
        return {"floor": None if floor is True else floor, "times": times}
