"""The flow `become`: a subject flows onto a model or a solid."""

from pipeline.plugin import Plugin

PLUGIN = Plugin(
    name="become",
    version="1",
    flows={"become": "pipeline.plugins.become.become_document:BecomeDocument"},
    unneeded=("pipeline.plugins.become.unneeded_fits:unneeded_fits",),
)
