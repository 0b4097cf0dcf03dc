"""Turntables: an object turned before the camera, then the lights around it."""

from pipeline.plugin import Command, Plugin

PLUGIN = Plugin(
    name="turntable",
    version="1",
    commands={
        "turntable": Command(
            "pipeline.plugins.turntable.turntable_movie:turntable",
            "Render an object turning, then the lights turning around it.",
            "Render",
        )
    },
)
