"""Sampled velocities: grids in files of VTK and numpy, as the flow `sampled`."""

from flowsculpt.api import Plugin

PLUGIN = Plugin(
    name="sampled",
    version="1",
    flows={"sampled": "flowsculpt.pipeline.plugins.sampled.sampled_document:SampledDocument"},
)
