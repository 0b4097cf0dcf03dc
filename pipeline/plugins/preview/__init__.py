"""Previews: stills and movies by a rasteriser, first pictures of a run, and the live page."""

from pipeline.plugin import Command, Plugin

PLUGIN = Plugin(
    name="preview",
    version="1",
    commands={
        "preview": Command(
            "pipeline.plugins.preview.preview_command:preview",
            "Draw a shot in seconds, without a path tracer, or live while you edit.",
            "Look",
        )
    },
    watchers=("pipeline.plugins.preview.first_look:first_look",),
)
