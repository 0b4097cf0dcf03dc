"""The flow `contact`: a subject gives way to a floor."""

from flowsculpt.api import Plugin

PLUGIN = Plugin(
    name="contact",
    version="2",
    flows={"contact": "flowsculpt.pipeline.plugins.contact.contact_document:ContactDocument"},
)
