"""People: figures that show how large a sculpture is."""

from flowsculpt.api import Plugin

PLUGIN = Plugin(
    name="people", version="1", subjects={"person": "flowsculpt.pipeline.plugins.people.person:PersonKind"}
)
