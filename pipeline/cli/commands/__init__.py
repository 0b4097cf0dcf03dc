"""The commands of the core: each is a function in a module here."""

from pipeline.plugin import Command, Plugin

PLUGIN = Plugin(
    name="flowsculpt",
    version="1",
    commands={
        "new": Command(
            "pipeline.cli.commands.new_command:new",
            "Begin a shot, or a show: write files that are ready to render.",
            "Write shots",
        ),
        "validate": Command(
            "pipeline.cli.commands.validate_command:validate",
            "Check shot files and report every error by file, line and column.",
            "Write shots",
        ),
        "flows": Command(
            "pipeline.cli.commands.schema_command:flows",
            "List the flows, or the parameters of one.",
            "Write shots",
        ),
        "schema": Command(
            "pipeline.cli.commands.schema_command:schema",
            "Print the JSON Schema by which editors complete and check shot files.",
            "Write shots",
        ),
        "simulate": Command(
            "pipeline.cli.commands.render_commands:simulate", "Simulate the mesh frames of shots.", "Render"
        ),
        "render": Command(
            "pipeline.cli.commands.render_commands:render",
            "Render frames of shots and assemble their movies.",
            "Render",
        ),
        "film": Command(
            "pipeline.cli.commands.render_commands:film",
            "Render every shot of an edit and cut them into a film.",
            "Render",
        ),
        "stills": Command(
            "pipeline.cli.commands.render_commands:stills",
            "Write frames as PNG or JPEG, rendering what is missing.",
            "Render",
        ),
        "resample": Command(
            "pipeline.cli.commands.resample_command:resample", "Resample one mesh file.", "Maintain"
        ),
    },
)
"""What the core adds, by the contract that plug-ins have."""
