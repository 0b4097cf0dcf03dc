"""Published versions of shots."""

from pipeline.plugin import Command, Plugin

PLUGIN = Plugin(
    name="versions",
    version="1",
    commands={
        "publish": Command(
            "pipeline.plugins.versions.version_commands:publish",
            "Freeze a rendered shot as its next version.",
            "Deliver",
        ),
        "versions": Command(
            "pipeline.plugins.versions.version_commands:versions", "List published versions.", "Deliver"
        ),
        "reproduce": Command(
            "pipeline.plugins.versions.version_commands:reproduce",
            "Render a published version again, and compare.",
            "Deliver",
        ),
    },
    sequences=("pipeline.plugins.versions.publishing:published_sequences",),
)
