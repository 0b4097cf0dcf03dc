"""The entry `sampled` of flows in a shot file."""

from typing import Annotated, Any, Self

from pydantic import PrivateAttr, ValidationInfo, model_validator

from flowsculpt.api.flows import ParameterDoc, Sampled, Samples
from flowsculpt.api.shots import Clock, FlowParameters, ParseContext, Positive
from flowsculpt.pipeline.plugins.sampled.file_sequences import files_named
from flowsculpt.pipeline.plugins.sampled.grid_files import read_samples


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
        paths = context.attempt(lambda: files_named(self.file, context))
        self._samples = context.attempt(lambda: read_samples(paths, self.array, float(self.interval)))
        context.digests.update(zip(paths, self._samples.digests, strict=True))
        return self

    def own_values(self, clock: Clock) -> dict[str, Any]:
        return {"samples": self._samples}
