"""The flow `become`: a subject flows onto a model or a solid."""

from flowsculpt.api import Plugin

PLUGIN = Plugin(
    name="become",
    version="1",
    flows={"become": "flowsculpt.pipeline.plugins.become.become_document:BecomeDocument"},
    extras="flowsculpt.pipeline.plugins.become.become_extras:BecomeExtras",
)
