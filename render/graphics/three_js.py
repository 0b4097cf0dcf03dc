"""three.js, which draws meshes on pages, and which set-up fetches.

    python -m flowsculpt.render.graphics.three_js    fetch it, unless it is installed

The package `nicegui` ships it as one file, with its controls; `three_js.txt` beside this module pins the
release by its hash. Only this file of the package is kept.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

from flowsculpt.render.base import python_process
from flowsculpt.render.base.atomic_write import atomic_write
from flowsculpt.render.base.render_errors import MachineError, MissingInputError

REQUIREMENTS = Path(__file__).with_name("three_js.txt")

PACKED = Path("nicegui", "elements", "scene", "dist", "index.js")  # the path of three.js in the package

FETCH = python_process.command_line("flowsculpt.render.graphics.three_js")


def three_js_script(otherwise: str) -> str:
    """Return the text of three.js, from which a page makes the module: browsers load none from local folders.

    otherwise  what follows where it is not installed, as `the page has no 3-D view`

    Raises MissingInputError with these words, and how to install it.
    """
    try:
        text = installed_file().read_text(encoding="utf-8")
    except OSError:
        raise MissingInputError(f"three.js is not installed, so {otherwise}; {FETCH} fetches it") from None
    return re.sub(r"\n//# sourceMappingURL=\S+\s*$", "\n", text)


def fetch() -> None:
    """Fetch three.js unless it is installed. Raises MachineError."""
    if installed_file().exists():
        return
    with tempfile.TemporaryDirectory() as work:
        pip = (
            python_process.python_command("pip") if find_spec("pip") else ["uv", "pip"]
        )  # uv makes venvs without
        words = ["install", "--quiet", "--no-deps", "--require-hashes", "--target", work]
        try:
            done = subprocess.run(
                [*pip, *words, "-r", str(REQUIREMENTS)], env=python_process.environment(), cwd=work
            )
        except FileNotFoundError:
            raise MachineError(
                "three.js cannot be fetched: neither pip nor uv is installed; pages have no 3-D view"
            ) from None
        if done.returncode or not (Path(work) / PACKED).exists():
            raise MachineError(
                f"three.js cannot be fetched (see {pip[-1]}'s message); pages have no 3-D view"
            )
        with atomic_write(installed_file()) as draft:
            shutil.copyfile(Path(work) / PACKED, draft)


def installed_file() -> Path:
    """Return the path of three.js in the environment, named by its release."""
    release = re.search(r"^nicegui==(\S+)", REQUIREMENTS.read_text(encoding="utf-8"), re.MULTILINE)
    assert release, "the requirement names one release"
    return Path(sys.prefix) / "web" / f"three.nicegui-{release[1]}.js"


if __name__ == "__main__":
    try:
        fetch()
    except MachineError as error:
        print(error, file=sys.stderr)
        sys.exit(error.exit_code)
