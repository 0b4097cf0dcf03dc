"""The entry `move` of flows in a shot file."""

from typing import Annotated, Any, Self

from pydantic import model_validator

from flowsculpt.api.flows import ParameterDoc
from flowsculpt.api.shots import Clock, FlowParameters, Positive, Triple
from flowsculpt.pipeline.plugins.moves.move_flow import Move


class MoveDocument(FlowParameters):
    """A way, a turn, and how late far parts follow."""

    flow = Move
    example = "{by: {keys: {1: [0, 0, 0], 24: [0, -2, 0]}, ease: drop}}"

    leads: Annotated[
        Triple | None, ParameterDoc("the place that is not late; by default the centre", "units")
    ] = None
    along: Annotated[
        Triple | None,
        ParameterDoc("direction in which parts are later; by default the distance from leads in all"),
    ] = None
    reach: Annotated[
        Positive | None,
        ParameterDoc("distance from there of what is late by the lag; by default the subject's", "units"),
    ] = None

    @model_validator(mode="after")
    def _leads_somewhere(self) -> Self:
        if self.along is not None and not any(self.along):
            raise ValueError("along has no direction. Write along: [0, 1, 0] for the upper parts later.")
        return self

    def build(self, clock: Clock) -> Any:
        """Return the flow itself: its steps are those of other flows, which plans look into."""
        return super().build(clock).plugin_flow

    def own_values(self, clock: Clock) -> dict[str, Any]:
        leads, along = (None if v is None else tuple(float(x) for x in v) for v in (self.leads, self.along))
        reach = None if self.reach is None else float(self.reach)
        return {"leads": leads, "along": along, "reach": reach}
