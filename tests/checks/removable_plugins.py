"""Take plug-ins out of a copy of the project, each with its tests and its entry, and see what still works.

    python tests/checks/removable_plugins.py [NAME | NAME,NAME …] [-k TESTS]

Without names, each plug-in goes alone, then ten pairs. In the copy the help is shown, two frames of a shot
are rendered to a movie, all tests are collected, the quick ones run, and the documentation is built.
"""

from __future__ import annotations

import argparse
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
from importlib.metadata import distribution
from itertools import combinations
from pathlib import Path

ROOT = Path(__file__).parents[2]
PLUGINS = sorted(place.parent.name for place in (ROOT / "pipeline/plugins").glob("*/__init__.py"))

SHOT = "A010_cube"

STEPS = {
    "help": ("-m", "flowsculpt", "--help"),
    "film": ("-m", "flowsculpt", "--no-progress", "render", SHOT, "-f", "1-2", "--scale", "20%"),
    "collection": ("-m", "pytest", "-q", "--collect-only", "-p", "no:cacheprovider"),
    "quick tests": (
        "-m",
        "pytest",
        "-q",
        "-m",
        "not (soak or renderer or slow)",
        "-n",
        "2",
        "--dist",
        "loadfile",
    ),
    "documentation": ("-m", "sphinx", "-W", "--keep-going", "-q", "docs", "docs/site"),
}
"""Words after `python`, by what they show."""


def copy_without(names: list[str], folder: Path) -> None:
    """Copy the files of the project, as git lists them, without plug-ins, their tests and their entries."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        check=True,
    )
    gone = tuple(f"{place}/{name}/" for name in names for place in ("pipeline/plugins", "tests/plugins"))
    for name in filter(None, os.fsdecode(listed.stdout).split("\0")):
        if not name.startswith(gone) and (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name)
    entries = re.compile(rf"^({'|'.join(names)}) = .*\n", re.MULTILINE)
    project = folder / "pyproject.toml"
    project.write_text(entries.sub("", project.read_text("utf-8")), "utf-8")
    installed = distribution("flowsculpt")
    facts = folder / f"flowsculpt-{installed.version}.dist-info"  # found before that of the environment
    facts.mkdir()
    for name in ("METADATA", "entry_points.txt"):
        (facts / name).write_text(entries.sub("", installed.read_text(name) or ""), "utf-8")


def faults_without(names: list[str], only: str | None) -> list[str]:
    """Return the steps that fail in a copy without plug-ins; the end of what each printed goes to stderr."""
    with tempfile.TemporaryDirectory(prefix="without-") as place:
        folder = Path(place)
        copy_without(names, folder)
        environment = {**os.environ, "PYTHONPATH": str(folder)}
        faults = []
        for step, words in STEPS.items():
            if only and only not in step:
                continue
            done = subprocess.run(
                [sys.executable, *words], cwd=folder, env=environment, capture_output=True, text=True
            )
            if done.returncode:
                faults.append(step)
                print(
                    f"--- {', '.join(names)}: {step}\n{(done.stdout + done.stderr)[-6000:]}", file=sys.stderr
                )
        return faults


def main() -> int:
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("names", nargs="*", help="plug-ins; those between commas go together")
    options.add_argument("-k", dest="only", help="only the steps whose names contain this")
    given = options.parse_args()
    pairs = random.Random(0).sample(list(combinations(PLUGINS, 2)), 10)
    cases = [name.split(",") for name in given.names] or [[name] for name in PLUGINS] + [*map(list, pairs)]
    failed = 0
    for names in cases:
        faults = faults_without(names, given.only)
        failed += bool(faults)
        print(
            f"without {' and '.join(names)}: {', '.join(faults) + ' failed' if faults else 'all works'}",
            flush=True,
        )
    return bool(failed)


if __name__ == "__main__":
    sys.exit(main())
