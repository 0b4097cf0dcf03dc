"""Completion: commands, options and names completed at Tab, in bash, zsh and fish."""

from flowsculpt.api import Command, Plugin

PLUGIN = Plugin(
    name="completion",
    version="1",
    commands={
        "completion": Command(
            "flowsculpt.pipeline.plugins.completion.completion_command:completion",
            "Print a script by which Tab completes commands in bash, zsh or fish.",
            "Maintain",
        ),
    },
)
