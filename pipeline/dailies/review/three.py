"""three.js, which draws meshes on the page; set-up fetches it.

    python -m pipeline.dailies.review.three    fetch it, unless it is installed

The package `nicegui` ships it as one file, with its controls; `requirements.txt` beside this module pins the
release by its hash. Only this file of the package is kept.
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
"""The file's path in the package."""

HINT = (
    "three.js is not installed, so the page has no 3-D view; "
    f"{Path(sys.executable).name} -m pipeline.dailies.review.three fetches it"
)


def place() -> Path:
    """Return its path in the environment, named by its release."""
    release = re.search(r"^nicegui==(\S+)", REQUIREMENTS.read_text(), re.MULTILINE)
    assert release, "the requirement names one release"
    return Path(sys.prefix) / "web" / f"three.nicegui-{release[1]}.js"


def bundle() -> str | None:
    """Return the text of the module; None if it is not installed.

    Browsers load no modules from local folders: the page makes the module from this text.
    """
    try:
        text = place().read_text(encoding="utf-8")
    except OSError:
        return None
    return re.sub(r"\n//# sourceMappingURL=\S+\s*$", "\n", text)


def fetch() -> None:
    """Fetch it unless it is installed. Raises MachineError."""
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
