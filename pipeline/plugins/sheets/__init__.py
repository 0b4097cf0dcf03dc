"""Contact sheets, wedges, and plots of what changes over the frames of a shot."""

from pipeline.plugin import Command, Plugin

PLUGIN = Plugin(
    name="sheets",
    version="1",
    commands={
        "sheet": Command(
            "pipeline.plugins.sheets.sheet_commands:sheet",
            "Draw a contact sheet of a shot's frames.",
            "Look",
        ),
        "figures": Command(
            "pipeline.plugins.sheets.sheet_commands:figures",
            "Plot the measures of a shot's meshes over its frames.",
            "Look",
        ),
        "curves": Command(
            "pipeline.plugins.sheets.sheet_commands:curves",
            "Draw everything in a shot that changes over time.",
            "Look",
        ),
        "wedge": Command(
            "pipeline.plugins.sheets.sheet_commands:wedge", "Render a shot in a grid of variations.", "Render"
        ),
    },
    sequences=("pipeline.plugins.sheets.wedge:wedge_sequences",),
)
