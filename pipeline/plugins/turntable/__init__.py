"""Turntables: an object turned before the camera, then the lights around it."""

from flowsculpt.api import Command, Plugin

PLUGIN = Plugin(
    name="turntable",
    version="1",
    frame_sources={"turntable": "flowsculpt.pipeline.plugins.turntable.turntable_frames:Turntable"},
    commands={
        "turntable": Command(
            "flowsculpt.pipeline.plugins.turntable.turntable_movie:turntable",
            "Render an object turning, then the lights turning around it.",
            "Render",
            folder="turntable",
        )
    },
)
