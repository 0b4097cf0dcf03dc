"""Farms: jobs for render managers, and the tasks that they run."""

from flowsculpt.api import Command, Plugin

_COMMANDS = "flowsculpt.pipeline.plugins.farm.farm_commands"

PLUGIN = Plugin(
    name="farm",
    version="1",
    commands={
        "task": Command(
            f"{_COMMANDS}:task", "Run part of a plan, as a worker of a render manager.", "Render"
        ),
        "export openjd": Command(f"{_COMMANDS}:openjd", "Open Job Description, for render managers."),
        "export plan": Command(f"{_COMMANDS}:plan", "What tasks of a render manager read."),
        "export flamenco": Command(f"{_COMMANDS}:flamenco", "A job of Flamenco, and its job type."),
    },
)
