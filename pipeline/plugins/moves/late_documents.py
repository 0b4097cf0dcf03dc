"""The entries `move` and `lag` of flows in a shot file."""

from typing import Annotated, Any, ClassVar, Self

from pydantic import AfterValidator, Field, GetJsonSchemaHandler, model_validator
from pydantic_core import CoreSchema

from flowsculpt.api.flows import Expression, ParameterDoc
from flowsculpt.api.shots import ByForm, Clock, FlowParameters, Positive, Triple
from flowsculpt.pipeline.plugins.moves.lag_flow import Lag
from flowsculpt.pipeline.plugins.moves.late_flow import PLACE
from flowsculpt.pipeline.plugins.moves.move_flow import Move

Seconds = Annotated[
    Annotated[float, Field(ge=0.0, le=5.0)]
    | Annotated[str, AfterValidator(lambda text: Expression(text, PLACE).text)],
    ByForm(lambda value: isinstance(value, str)),
]
"""A number of seconds, or a formula over the place."""

LATE = ParameterDoc("by which the farthest parts are late, or a formula over x, y and z", "s")


class LateDocument(FlowParameters):
    """How late far parts are. `seconds` is the name of the parameter that says by how much."""

    seconds_name: ClassVar[str]

    leads: Annotated[
        Triple | None,
        ParameterDoc("place that is not late; by default the centre, or [0, 0, 0]", "units"),
    ] = None
    along: Annotated[
        Triple | None,
        ParameterDoc("direction in which parts are later; by default the distance from leads in all"),
    ] = None
    reach: Annotated[
        Positive | None,
        ParameterDoc("distance from there of what is late by that much; by default the subject's", "units"),
    ] = None

    @model_validator(mode="after")
    def _says_where_once(self) -> Self:
        if self.along is not None and not any(self.along):
            raise ValueError("along has no direction. Write along: [0, 1, 0] for the upper parts later.")
        beside = [name for name in ("leads", "along", "reach") if getattr(self, name) is not None]
        if beside and isinstance(getattr(self, self.seconds_name), str):
            fact = f"a formula has the delay of each place, so {beside[0]} has no effect"
            raise ValueError(f"{fact}. Leave {beside[0]} out, or write {self.seconds_name} as a number.")
        return self

    def build(self, clock: Clock) -> Any:
        """Return the flow itself: its steps are those of other flows, which plans look into."""
        return super().build(clock).plugin_flow

    def own_values(self, clock: Clock) -> dict[str, Any]:
        leads, along = (None if v is None else tuple(float(x) for x in v) for v in (self.leads, self.along))
        reach = None if self.reach is None else float(self.reach)
        seconds = getattr(self, self.seconds_name)
        seconds = seconds if isinstance(seconds, str) else float(seconds)
        moments = tuple((frame, clock.flow_time(frame)) for frame in clock.frames)
        return {"seconds": seconds, "leads": leads, "along": along, "reach": reach, "moments": moments}


class MoveDocument(LateDocument):
    """A way, a turn, and how late far parts follow."""

    flow = Move
    example = "{by: {keys: {1: [0, 0, 0], 24: [0, -2, 0]}, ease: drop}}"
    seconds_name = "lag"

    lag: Annotated[Seconds, LATE] = 0.0


class LagDocument(LateDocument):
    """`0.2`, or `{seconds: 0.2}` with where."""

    flow = Lag
    example = "0.2"
    seconds_name = "seconds"

    seconds: Annotated[Seconds, LATE]

    @model_validator(mode="before")
    @classmethod
    def _bare(cls, value: Any) -> Any:
        return {"seconds": value} if isinstance(value, float | int | str) else value

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"anyOf": [handler(core), {"type": ["number", "string"]}]}
