"""Contact sheets and wedges."""

from flowsculpt.api import Command, Plugin

_COMMANDS = "flowsculpt.pipeline.plugins.sheets.sheet_commands"

PLUGIN = Plugin(
    name="sheets",
    version="1",
    commands={
        "sheet": Command(f"{_COMMANDS}:sheet", "Draw a contact sheet of a shot's frames.", "Look"),
        "wedge": Command(
            f"{_COMMANDS}:wedge", "Render a shot in a grid of variations.", "Render", folder="wedge"
        ),
    },
    extras="flowsculpt.pipeline.plugins.sheets.sheets_extras:SheetsExtras",
)
