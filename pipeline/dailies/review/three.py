"""three.js, which draws the meshes of a page: set-up fetches it, and it is part of no source of ours.

    python -m pipeline.dailies.review.three    get it, unless it is here

The package `nicegui` ships it as one file, with its controls; `requirements.txt` beside this says which
release, by its hash. The file alone is kept, and nothing else of the package.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from pipeline.errors import MachineError
from render.base.atomic_write import atomic_write

REQUIREMENTS = Path(__file__).with_name("requirements.txt")

HELD = Path("nicegui", "elements", "scene", "dist", "index.js")
"""Where the package has it."""

HINT = (
    "three.js is not here, so the page has no 3-D view; "
    f"{Path(sys.executable).name} -m pipeline.dailies.review.three gets it"
)


def place() -> Path:
    """Where it lies: in the environment, under a name that goes by its release."""
    release = re.search(r"^nicegui==(\S+)", REQUIREMENTS.read_text(), re.MULTILINE)
    assert release, "the requirement names one release"
    return Path(sys.prefix) / "web" / f"three.nicegui-{release[1]}.js"


def bundle() -> str | None:
    """The text of the module; None where it is not here.

    A page in a folder may load no modules from it: it has the text in a script, and makes the module of it.
    """
    try:
        text = place().read_text(encoding="utf-8")
    except OSError:
        return None
    return re.sub(r"\n//# sourceMappingURL=\S+\s*$", "\n", text)


def fetch() -> None:
    """Raises MachineError where it cannot be had."""
    if place().exists():
        return
    with tempfile.TemporaryDirectory() as work:
        words = ["install", "--quiet", "--no-deps", "--no-compile", "--require-hashes", "--target", work]
        done = subprocess.run([sys.executable, "-m", "pip", *words, "-r", str(REQUIREMENTS)])
        if done.returncode or not (Path(work) / HELD).exists():
            raise MachineError("three.js cannot be fetched, and pip says why; review pages have no 3-D view")
        with atomic_write(place()) as draft:
            shutil.copyfile(Path(work) / HELD, draft)


def main() -> int:
    try:
        fetch()
    except MachineError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
