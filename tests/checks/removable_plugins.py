"""Take plug-ins out of a copy of the project, each with its tests and its entry, and see what still works.

    python tests/checks/removable_plugins.py [NAME | NAME,NAME …] [-k STEP] [--pairs COUNT]

In the copy the help is shown, two frames of a shot are rendered to a film, all tests are collected, the
quick ones run, and the documentation is built. Without names each plug-in goes alone, then pairs that are
drawn with a fixed seed. Each step of each case prints a line, and below it what failed.
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
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import distribution
from itertools import combinations
from pathlib import Path

ROOT = Path(__file__).parents[2]
PLUGINS = sorted(place.parent.name for place in (ROOT / "pipeline/plugins").glob("*/__init__.py"))
PLACES = ("pipeline/plugins", "tests/plugins")

QUIETLY = ("-m", "pytest", "-q", "--no-header", "-p", "no:cacheprovider")

QUALITY = "draft.scale20"

STEPS = {
    "help": ("-m", "flowsculpt", "--help"),
    "film": ("-m", "flowsculpt", "--no-progress", "film", "short", "-q", QUALITY),
    "collection": (*QUIETLY, "--collect-only", "-qq"),
    "quick tests": (*QUIETLY, "-m", "not (soak or renderer or slow)", "-n", "2", "--dist", "loadfile"),
    "documentation": ("-m", "sphinx", "-W", "--keep-going", "-q", "docs", "{made}/site"),
}
"""Words after `python`, by what they show; `{made}` is a new folder."""

FILM = "title: Two frames\nshots: [{shot: B100_torus, frames: 1-2}]\ntitle_seconds: 0\ncredits_seconds: 0\n"

FAULT = re.compile(r"^(FAILED|ERROR|E  |.*(error|warning)\b).*", re.MULTILINE | re.IGNORECASE)
"""Lines of output that say what failed."""


def copy_project(folder: Path) -> None:
    """Copy the files of the project, as git lists them, with what Python knows of the installed one."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        check=True,
    )
    for name in filter(None, os.fsdecode(listed.stdout).split("\0")):
        if (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name)
    installed = distribution("flowsculpt")
    facts = folder / f"flowsculpt-{installed.version}.dist-info"  # found before that of the environment
    facts.mkdir()
    for name in ("METADATA", "entry_points.txt"):
        (facts / name).write_text(installed.read_text(name) or "", "utf-8")


@contextmanager
def taken_out(names: list[str], folder: Path) -> Iterator[None]:
    """Take plug-ins, their tests and their entries out of a copy, and put them back in the end."""
    aside = folder.with_name("aside")
    lists = [folder / "pyproject.toml", *folder.glob("*.dist-info/entry_points.txt")]
    texts = [file.read_text("utf-8") for file in lists]
    entries = re.compile(rf"^({'|'.join(names)}) = .*\n", re.MULTILINE)
    moves = [(folder / place / name, aside / place / name) for place in PLACES for name in names]
    moves = [(place, away) for place, away in moves if place.is_dir()]
    try:
        for file, text in zip(lists, texts, strict=True):
            file.write_text(entries.sub("", text), "utf-8")
        for place, away in moves:
            away.parent.mkdir(parents=True, exist_ok=True)
            place.rename(away)
        yield
    finally:
        for place, away in moves:
            shutil.rmtree(place, ignore_errors=True)  # what Python has compiled there
            away.rename(place)
        for file, text in zip(lists, texts, strict=True):
            file.write_text(text, "utf-8")


def fault_of(step: str, folder: Path) -> str | None:
    """Return what a step says of its failure in a copy, up to 30 lines; None where it works."""
    with tempfile.TemporaryDirectory(prefix="made-") as made:
        (Path(made) / "shots").mkdir()
        shutil.copy2(folder / "shots/B100_torus.yaml", Path(made) / "shots")
        (Path(made) / "shots/short.yaml").write_text(FILM, "utf-8")
        done = subprocess.run(
            [sys.executable, *(word.format(made=made) for word in STEPS[step])],
            cwd=made if step == "film" else folder,
            env={**os.environ, "PYTHONPATH": str(folder)},
            capture_output=True,
            text=True,
        )
    if done.returncode == 0:
        return None
    said = done.stdout + done.stderr
    lines = said.splitlines()
    if len(lines) > 30:
        lines = [found[0] for found in FAULT.finditer(said)] or lines
    return "\n".join(f"    {line[:300]}" for line in lines[-30:])


def main() -> int:
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("names", nargs="*", help="plug-ins; those between commas go together")
    options.add_argument("-k", dest="only", default="", help="only the steps whose names contain this")
    options.add_argument("--pairs", type=int, help="how many pairs to draw: 10 without names, else none")
    given = options.parse_args()
    count = given.pairs if given.pairs is not None else 0 if given.names else 10
    pairs = random.Random(0).sample(list(combinations(PLUGINS, 2)), count)
    alone = given.names or ([] if given.pairs else PLUGINS)
    cases = [*(name.split(",") for name in alone), *map(list, pairs)]
    if unknown := {name for case in cases for name in case} - set(PLUGINS):
        options.error(f"no such plug-in: {', '.join(sorted(unknown))}; there are {', '.join(PLUGINS)}")
    failed = 0
    with tempfile.TemporaryDirectory(prefix="without-") as place:
        folder = Path(place) / "project"
        copy_project(folder)
        for names in cases:
            with taken_out(names, folder):
                for step in (step for step in STEPS if given.only in step):
                    begun = time.monotonic()
                    fault = fault_of(step, folder)
                    failed += fault is not None
                    word = "works" if fault is None else "FAILS"
                    took = time.monotonic() - begun
                    print(f"{'+'.join(names):24} {step:14} {word} {took:4.0f} s", flush=True)
                    if fault is not None:
                        print(fault, flush=True)
    return bool(failed)


if __name__ == "__main__":
    sys.exit(main())
