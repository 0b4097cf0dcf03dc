"""The entry `become` of flows in a shot file."""

import math
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, PrivateAttr, ValidationInfo, model_validator

from flowsculpt.api import plural
from flowsculpt.api.flows import Keyframes, Number, ParameterDoc
from flowsculpt.api.shots import (
    Clock,
    FlowParameters,
    Model,
    OneOfSeveral,
    ParseContext,
    Positive,
    Solid,
    Triple,
    WeightField,
    one_of,
)
from flowsculpt.pipeline.plugins.become.become_flow import Become
from flowsculpt.pipeline.plugins.become.stored_fits import PlacedShape

_OF_MODELS = ("scale", "fit", "up", "rotate", "prim")
_OF_SOLIDS = ("size", "radius", "length", "tube_radius", "caps")


class BecomeDocument(OneOfSeveral, FlowParameters):
    """A model or a solid that the subject becomes, and when."""

    flow = Become
    noun, several = "what the subject becomes", ("model", "solid")
    example = "{model: bunny.obj, fit: 2, from: 1, to: 48}"

    model: Annotated[str | None, ParameterDoc("a closed model in this file")] = None
    fit: Annotated[Positive | None, ParameterDoc("of the model: its largest extent, centred", "units")] = None
    scale: Annotated[Positive | None, ParameterDoc("of the model: factor on its coordinates; or use fit")] = (
        None
    )
    up: Annotated[Literal["y", "z"] | None, ParameterDoc("of the model: its axis that points up")] = None
    rotate: Annotated[
        list[Annotated[float, Field(ge=-3600, le=3600)]] | None,
        Field(min_length=3, max_length=3),
        ParameterDoc("of the model: about x, then y, then z", "degrees"),
    ] = None
    prim: Annotated[str | None, ParameterDoc("of a USD stage: the path of the prim")] = None
    solid: Annotated[str | None, ParameterDoc("a solid, with its measures")] = None
    size: Annotated[
        list[Positive] | None,
        Field(min_length=2, max_length=3),
        ParameterDoc("of the solid: its sides", "units"),
    ] = None
    radius: Annotated[Positive | None, ParameterDoc("of the solid", "units")] = None
    length: Annotated[Positive | None, ParameterDoc("of the solid, from end to end", "units")] = None
    tube_radius: Annotated[Positive | None, ParameterDoc("of the tube of a torus", "units")] = None
    caps: Annotated[Literal["round", "flat"] | None, ParameterDoc("the ends of a rod")] = None
    place: Annotated[Triple | None, ParameterDoc("where its origin is; by default the scene's", "units")] = (
        None
    )
    begin: Annotated[Any, Field(alias="from"), ParameterDoc("frame, or seconds as 0.5s, when it begins")] = (
        None
    )
    end: Annotated[Any, Field(alias="to"), ParameterDoc("frame, or seconds, when it arrives")] = None
    ease: Annotated[
        str, one_of(Keyframes.EASE_NAMES, "easing"), ParameterDoc("how it leaves and arrives")
    ] = "sine_in_out"
    progress: Annotated[
        WeightField | None, ParameterDoc("in place of from and to: share of the way, from 0 to 1, keyed")
    ] = None
    detail: Annotated[
        Literal["coarse", "medium", "fine"], ParameterDoc("of the fit: about half a minute, one, or five")
    ] = "medium"

    _target: PlacedShape = PrivateAttr()

    @model_validator(mode="after")
    def _is_there(self, info: ValidationInfo) -> Self:
        given = {name: getattr(self, name) for name in (*_OF_MODELS, *_OF_SOLIDS)}
        given |= {name: float(given[name]) for name in ("scale", "fit") if given[name] is not None}
        given["rotate"] = self.rotate and tuple(map(math.radians, self.rotate))
        named = {name: value for name, value in given.items() if value is not None}
        self._require_times(info)
        if self.model is not None:
            _require_known(named, _OF_MODELS, "a model")
            path = ParseContext.of(info).mesh(self.model)
            subject: Solid | Model = Model.of_file(path, **named)
        else:
            if self.solid is None or self.solid not in Solid.KINDS:
                raise ValueError(f"{self.solid} is not a solid. Write one of {', '.join(Solid.KINDS)}.")
            measures = Solid.KINDS[self.solid].measures
            _require_known(named, measures, f"the {self.solid}")
            if self.size is not None and len(self.size) != (sides := np.size(measures["size"])):
                raise ValueError(f"size of the {self.solid} has {plural(sides, 'number')}. Correct it.")
            subject = Solid.of(self.solid, named)
        x, y, z = map(float, self.place or [0.0, 0.0, 0.0])
        self._target = PlacedShape(subject, (x, y, z))
        _ = self._target.mesh  # raises an error for one that is open
        return self

    def _require_times(self, info: ValidationInfo) -> None:
        clock: Clock | None = (info.context or {}).get("clock")
        if self.progress is not None:
            if self.begin is not None or self.end is not None:
                raise ValueError("become has progress as well as from or to. Remove one.")
            return
        if clock is None:
            return
        begin, end = (None if at is None else clock.seconds(at) for at in (self.begin, self.end))
        for name, at, seconds in (("from", self.begin, begin), ("to", self.end, end)):
            if at is not None and seconds is None:
                raise ValueError(f"{name}: {at} is not a time. Write a frame, such as 24, or seconds as 1s.")
        if self._times(clock)[0] >= self._times(clock)[1]:
            raise ValueError("become arrives before it begins. Write from below to.")
        if self._times(clock)[0] < 0.0:
            ParseContext.of(info).notes.append(
                f"become begins before frame {clock.frames.first}, in which the subject is at rest, so it "
                "does not arrive. Write a later from; or keep the frames, and choose some in the edit."
            )

    def _times(self, clock: Clock) -> tuple[float, float]:
        first = clock.seconds(clock.frames.first if self.begin is None else self.begin)
        last = clock.seconds(clock.frames.last if self.end is None else self.end)
        assert first is not None and last is not None, "the validator has refused others"
        return first, last

    def own_values(self, clock: Clock) -> dict[str, Any]:
        if self.progress is not None:
            given = self.progress
            progress: Number = float(given) if isinstance(given, int | float) else given.curve(clock)
        else:
            progress = Keyframes(self._times(clock), ((0.0,), (1.0,)), (self.ease, self.ease))
        return {"target": self._target, "progress": progress, "detail": self.detail}


def _require_known(named: dict[str, Any], known: Any, whose: str) -> None:
    """Refuse settings of the other kind of target."""
    for name in named:
        if name not in known:
            raise ValueError(f"{name} is not a setting of {whose}. Remove it.")
