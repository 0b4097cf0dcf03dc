"""What many commands take: which shots, which frames, how well."""

from __future__ import annotations

from typing import Annotated

import typer

from render.mitsuba.engine import VARIANTS
from render.scene.quality import QUALITIES

Shots = Annotated[list[str], typer.Argument(metavar="SHOT…", help="Names in shots/, or paths of shot files.")]
Frames = Annotated[
    str | None,
    typer.Option(
        "-f",
        "--frames",
        metavar="RANGE",
        help="Frames: 12, 1-48, 1-48x2, 1-24,30; 1-100:10 is coarse first. Or in words, as status tells "
        "them: missing, stale, failed. By default all.",
    ),
]
Variant = Annotated[
    str | None,
    typer.Option(
        help=f"Render with this Mitsuba variant: {', '.join(VARIANTS)}; by default the first that works."
    ),
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="Put a value in place of the shot's, such as flows.0.vortex.strength=2; may be given again.",
    ),
]
AllowCode = Annotated[
    bool, typer.Option("--allow-code", help="Let shots run the Python files that they name as flows.")
]
Quality = Annotated[str, typer.Option("-q", "--quality", help=f"One of {', '.join(QUALITIES)}.")]

Crop = Annotated[
    str | None,
    typer.Option(
        metavar="X0,Y0,X1,Y1",
        help="Render a part: its left, upper, right and lower edge, in shares of the picture or in pixels.",
    ),
]
Scale = Annotated[
    str | None, typer.Option(metavar="PERCENT", help="Render smaller or larger pictures: 50%, or 0.5.")
]
