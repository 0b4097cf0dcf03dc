"""Meshes over time that another program made, as subjects: numbered files, and files with an animation."""

from flowsculpt.api import Plugin

PLUGIN = Plugin(
    name="sequences",
    version="1",
    subjects={"sequence": "flowsculpt.pipeline.plugins.sequences.sequence_document:MeshSequenceDocument"},
)
