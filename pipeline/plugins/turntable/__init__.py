"""Turntables: an object turned before the camera, then the lights around it."""

from pipeline.plugin import Command, Plugin

PLUGIN = Plugin(
    name="turntable",
    version="1",
    commands={
        "turntable": Command(
            "pipeline.plugins.turntable.turntable_command:turntable",
            "Turn an object, then the lights around it, before the camera.",
            "Render",
        ),
    },
)
