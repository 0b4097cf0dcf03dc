"""Contact sheets, wedges, and curves of what a shot says of its frames."""

from flowsculpt.api import Command, Plugin

_COMMANDS = "flowsculpt.pipeline.plugins.sheets.sheet_commands"

PLUGIN = Plugin(
    name="sheets",
    version="1",
    commands={
        "sheet": Command(f"{_COMMANDS}:sheet", "Draw a contact sheet of a shot's frames.", "Look"),
        "curves": Command(f"{_COMMANDS}:curves", "Draw everything in a shot that changes over time.", "Look"),
        "wedge": Command(
            f"{_COMMANDS}:wedge", "Render a shot in a grid of variations.", "Render", folder="wedge"
        ),
    },
    extras="flowsculpt.pipeline.plugins.sheets.sheets_extras:SheetsExtras",
)
