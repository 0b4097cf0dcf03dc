"""People: figures that show how large a sculpture is."""

from pipeline.plugin import Plugin

PLUGIN = Plugin(name="people", version="1", subjects={"person": "pipeline.plugins.people.person:PersonKind"})
