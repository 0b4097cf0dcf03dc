"""Authoring: new shots and shows, checks and schemas of shot files, and lists of flows."""

from flowsculpt.api import Command, Plugin

PLUGIN = Plugin(
    name="authoring",
    version="1",
    commands={
        "new": Command(
            "flowsculpt.pipeline.plugins.authoring.new_command:new",
            "Begin a shot, or a show: write files that are ready to render.",
            "Write shots",
            also="create init",
            opening="`flowsculpt new --show my_show` writes a folder to work in.",
        ),
        "validate": Command(
            "flowsculpt.pipeline.plugins.authoring.validate_command:validate",
            "Check shot files and report every error by file, line and column.",
            "Write shots",
            also="check lint",
        ),
        "flows": Command(
            "flowsculpt.pipeline.plugins.authoring.schema_command:flows",
            "List the flows, or the parameters of one.",
            "Write shots",
        ),
        "schema": Command(
            "flowsculpt.pipeline.plugins.authoring.schema_command:schema",
            "Print the JSON Schema by which editors complete and check shot files.",
            "Write shots",
        ),
    },
    extras="flowsculpt.pipeline.plugins.authoring.authoring_extras:AuthoringExtras",
)
