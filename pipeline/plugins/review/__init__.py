"""The review page: pictures of shots side by side, measures of their meshes, and notes on them."""

from flowsculpt.api import Command, Plugin

_COMMANDS = "flowsculpt.pipeline.plugins.review.review_commands"
_FIGURES = "flowsculpt.pipeline.plugins.review.figures"

PLUGIN = Plugin(
    name="review",
    version="1",
    commands={
        "review": Command(
            f"{_COMMANDS}:review",
            "Write a page for reviewing shots frame by frame and writing notes.",
            "Look",
            folder="review",
        ),
        "notes": Command(f"{_COMMANDS}:notes", "List the notes that reviewers wrote about a shot.", "Look"),
        "figures": Command(
            f"{_FIGURES}:figures", "Plot the measures of a shot's meshes over its frames.", "Look"
        ),
        "curves": Command(f"{_FIGURES}:curves", "Draw everything in a shot that changes over time.", "Look"),
    },
    extras="flowsculpt.pipeline.plugins.review.review_extras:ReviewExtras",
)
