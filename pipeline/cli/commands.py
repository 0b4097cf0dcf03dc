"""The commands of the core."""

from flowsculpt.pipeline.plugin import Command, Plugin

_COMMANDS = "flowsculpt.pipeline.cli.render_commands"

PLUGIN = Plugin(
    name="flowsculpt",
    version="1",
    commands={
        "simulate": Command(f"{_COMMANDS}:simulate", "Simulate the mesh frames of shots.", "Render"),
        "render": Command(
            f"{_COMMANDS}:render", "Render frames of shots and assemble their movies.", "Render"
        ),
        "film": Command(
            f"{_COMMANDS}:film",
            "Render every shot of an edit and cut them into a film.",
            "Render",
            also="build make",
            opening="`flowsculpt film` renders the film of a folder.",
        ),
        "stills": Command(
            f"{_COMMANDS}:stills", "Write frames as PNG or JPEG, rendering what is missing.", "Render"
        ),
        "doctor": Command(
            "flowsculpt.pipeline.cli.doctor_command:doctor",
            "Show what is installed, and what would make it faster.",
            "Maintain",
        ),
    },
)
"""What the core adds, by the contract that plug-ins have."""
