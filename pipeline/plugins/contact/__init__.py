"""The flow `contact`: a subject gives way to a floor and to other subjects."""

from flowsculpt.api import Plugin

PLUGIN = Plugin(
    name="contact",
    version="5",
    flows={"contact": "flowsculpt.pipeline.plugins.contact.contact_document:ContactDocument"},
)
