"""Entries of flows in a shot file: `sampled`, `attraction` and `wind`."""

from itertools import pairwise
from typing import Annotated, Any, Self

import numpy as np
from pydantic import Field, PrivateAttr, ValidationInfo, field_validator, model_validator

from flowsculpt import UsageError, read_mesh
from flowsculpt.api.flows import ParameterDoc, Sampled, Samples
from flowsculpt.api.shots import (
    Clock,
    FlowParameters,
    OneOfSeveral,
    ParseContext,
    Positive,
    Triple,
)
from flowsculpt.pipeline.plugins.fields.attraction import Attraction, Target, Wind
from flowsculpt.pipeline.plugins.fields.file_sequences import files_named
from flowsculpt.pipeline.plugins.fields.grid_files import read_samples


class SampledDocument(FlowParameters):
    """Samples from files, which are read with the shot, so that their mistakes are reported with it."""

    flow = Sampled

    file: Annotated[str, ParameterDoc("where the samples are; with a * a sequence of files")]
    array: Annotated[
        str | None, ParameterDoc("the name of the velocities in a VTK file that holds several")
    ] = None
    interval: Annotated[Positive, ParameterDoc("from file to file", "s")] = 1.0

    _samples: Samples = PrivateAttr()

    @model_validator(mode="after")
    def _are_readable(self, info: ValidationInfo) -> Self:
        context = ParseContext.of(info)
        paths = files_named(self.file, context)
        self._samples = read_samples(paths, self.array, float(self.interval))
        context.digests.update(zip(paths, self._samples.digests, strict=True))
        return self

    def own_values(self, clock: Clock) -> dict[str, Any]:
        return {"samples": self._samples}


class AttractionDocument(OneOfSeveral, FlowParameters):
    """Attraction to points, a curve or a mesh."""

    noun, several = "the target of attraction", ("points", "curve", "mesh")

    flow = Attraction

    points: Annotated[
        list[Triple] | None, Field(min_length=1), ParameterDoc("the nearest of these attracts", "units")
    ] = None
    curve: Annotated[
        list[Triple] | None,
        Field(min_length=2),
        ParameterDoc("a smooth curve through these attracts", "units"),
    ] = None
    mesh: Annotated[str | None, ParameterDoc("the surface in this file attracts")] = None
    closed: Annotated[bool, ParameterDoc("joins the last point of the curve to the first")] = False
    scale: Annotated[Positive, ParameterDoc("factor on the mesh")] = 1.0

    _target: Target = PrivateAttr()

    @model_validator(mode="after")
    def _to_one(self, info: ValidationInfo) -> Self:
        if self.points is not None:
            self._target = Target.points(np.array(self.points))
        elif self.curve is not None:
            self._target = Target.curve(np.array(self.curve), self.closed)
        else:
            file = ParseContext.of(info).mesh(str(self.mesh))
            self._target = Target.surface(read_mesh(file), float(self.scale))
        return self

    def own_values(self, clock: Clock) -> dict[str, Any]:
        return {"target": self._target}


class WindDocument(FlowParameters):
    flow = Wind

    through: Annotated[list[Triple], Field(min_length=2), ParameterDoc("points of the curve", "units")]

    @field_validator("through")
    @classmethod
    def _has_directions(cls, through: list[list[float]]) -> list[list[float]]:
        for point, following in pairwise(through):
            if point == following:
                raise UsageError(
                    f"the curve goes through {point} twice in a row, so it has no direction there. "
                    "Remove one."
                )
        return through

    def own_values(self, clock: Clock) -> dict[str, Any]:
        return {"through": tuple((float(x), float(y), float(z)) for x, y, z in self.through)}
