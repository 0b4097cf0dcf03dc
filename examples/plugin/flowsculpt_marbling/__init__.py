"""Marbled paper: a comb that draws inks into feathers, the inks, and mist between camera and subject."""

from flowsculpt.api import Command, PictureStage, Plugin, ShotEntry

PLUGIN = Plugin(
    name="marbling",
    version="1.0",
    api=2,
    flows={"comb": "flowsculpt_marbling.comb:Comb"},
    looks={"inks": "flowsculpt_marbling.inks:INKS"},
    encodes={"wall": "flowsculpt_marbling.inks:WALL"},
    entries={
        "mist": ShotEntry(
            "flowsculpt_marbling.mist:Mist",
            PictureStage("flowsculpt_marbling.mist:add_mist", version=1, doing="adding mist"),
        )
    },
    commands={
        "inks": Command("flowsculpt_marbling.commands:inks", "List the inks of marbling.inks.", "Look"),
        "export csv": Command("flowsculpt_marbling.commands:csv", "Vertices, faces and area of each frame."),
    },
)
