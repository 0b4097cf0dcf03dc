"""The entry `contact` of flows in a shot file."""

from typing import Any

from flowsculpt.api.shots import Clock, FlowParameters
from flowsculpt.pipeline.plugins.contact.contact_flow import Contact


class ContactDocument(FlowParameters):
    """A floor, and how soft the subject is."""

    flow = Contact
    example = "{floor: -1, softness: 1}"

    def build(self, clock: Clock) -> Any:
        """Return the flow itself: its steps are those of other flows, which plans look into."""
        return super().build(clock).plugin_flow
