"""Published versions of shots."""

from flowsculpt.api import Command, Plugin

_COMMANDS = "flowsculpt.pipeline.plugins.versions.version_commands"

PLUGIN = Plugin(
    name="versions",
    version="1",
    commands={
        "publish": Command(
            f"{_COMMANDS}:publish",
            "Freeze a rendered shot as its next version.",
            "Deliver",
            folder="published",
        ),
        "versions": Command(f"{_COMMANDS}:versions", "List published versions.", "Deliver"),
        "reproduce": Command(
            f"{_COMMANDS}:reproduce",
            "Render a published version again, and compare.",
            "Deliver",
            folder="repeated",
        ),
    },
    observer="flowsculpt.pipeline.plugins.versions.hooks:HookCaller",
    extras="flowsculpt.pipeline.plugins.versions.versions_extras:VersionsExtras",
)
