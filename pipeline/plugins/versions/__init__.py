"""Published versions of shots."""

from flowsculpt.api import Command, Plugin

_COMMANDS = "flowsculpt.pipeline.plugins.versions.version_commands"

PLUGIN = Plugin(
    name="versions",
    version="1",
    commands={
        "publish": Command(f"{_COMMANDS}:publish", "Freeze a rendered shot as its next version.", "Deliver"),
        "versions": Command(f"{_COMMANDS}:versions", "List published versions.", "Deliver"),
        "reproduce": Command(
            f"{_COMMANDS}:reproduce", "Render a published version again, and compare.", "Deliver"
        ),
    },
    summaries=("flowsculpt.pipeline.plugins.versions.hooks:tell_of_run",),
    delivered=("flowsculpt.pipeline.plugins.versions.hooks:tell_of_delivery",),
    sequences=("flowsculpt.pipeline.plugins.versions.publishing:published_sequences",),
)
