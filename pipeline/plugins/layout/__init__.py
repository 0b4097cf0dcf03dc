"""Layout: copies on a grid, in a ring or disc, along a spiral, or on a surface."""

from flowsculpt.api import Plugin

PLUGIN = Plugin(
    name="layout",
    version="1",
    subjects={"layout": "flowsculpt.pipeline.plugins.layout.copy_layouts:OneLayout"},
)
