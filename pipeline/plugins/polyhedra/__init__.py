"""Version 1 of the resampler (1990): polyhedra with faces of any number of sides, `method: polyhedra`."""

from flowsculpt.api import Plugin

PLUGIN = Plugin(
    name="polyhedra",
    version="1",
    resamplers={"polyhedra": "flowsculpt.pipeline.plugins.polyhedra.polyhedra_method:Polyhedra"},
)
