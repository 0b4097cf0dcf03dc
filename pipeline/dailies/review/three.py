"""three.js, which draws the meshes of a page: set-up unpacks it, and it is part of no source of ours.

The package `nicegui` has it as one file, with its controls; `requirements.txt` beside this says which, and
nothing else of it is used or installed.
"""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

from render.appear import appearing

PLACE = Path(sys.prefix) / "web" / "nicegui" / "elements" / "scene" / "dist" / "index.js"

REQUIREMENTS = Path(__file__).with_name("requirements.txt")

HINT = (
    "three.js is not set up here, so the page has no 3-D view; "
    f"{sys.executable} -m pip install --no-deps --require-hashes --target {Path(sys.prefix) / 'web'} "
    f"-r {REQUIREMENTS} gets it"
)


def bundle() -> str | None:
    """The text of the module; None where it is not set up."""
    try:
        text = PLACE.read_text(encoding="utf-8")
    except OSError:
        return None
    return re.sub(r"\n//# sourceMappingURL=\S+\s*$", "\n", text)


def write_script(text: str, path: Path) -> None:
    """Write the module as a script that keeps its text: a page of a folder may load no modules from it."""
    with appearing(path) as draft:
        draft.write_text(f"window.reviewThree = {json.dumps(text)};\n", encoding="utf-8")
