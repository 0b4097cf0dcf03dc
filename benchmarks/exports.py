"""`python -m benchmarks.exports [SHOT …]`: sizes and CPU seconds of exports of one mesh.

Each format is written by `flowsculpt export`, to an empty folder, in a process of its own. Refining comes
first, as part of `gltf`, and frames and cameras of pages and stages are simulated before they are written:
other formats read what is stored, so their CPU seconds are those of writing, with 1 to 2 of starting Python.
`A010_cube in 120 frames` is the same motion at 50 frames a second, so that it moves in all frames.
`usd` needs usd-core and `abc` alembic3d; formats are left out, and named, where their package is not there.
Prints a row for each shot and format, and the worst shot and the best of each format.
Writes `benchmarks/out/exports.json`.
"""

from __future__ import annotations

import os
import re
import sys
import tempfile
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

from benchmarks.first_film import CHECKOUT, run
from benchmarks.measured_shots import copy_shots
from benchmarks.report import Row, Target, keep, show
from flowsculpt.pipeline.plugins.interchange.unifying import Unification
from flowsculpt.pipeline.production.request.render_request import RenderRequest
from flowsculpt.pipeline.production.request.shot_source import SourceCache
from flowsculpt.pipeline.production.store.store import Store

SHOTS = ("A010_cube", "A020_lorenz", "B020_dough", "B030_marble", "B120_pillars")
"""A box with creases, an attractor, dough over 240 frames, marble with colours, three subjects and copies."""

LONG, FRAMES = "A010_cube in 120 frames", 120

FORMS = {
    "gltf": ("gltf",),
    "gltf --plain": ("gltf", "--plain"),
    "web": ("web",),
    "vat": ("vat",),
    "usd --one-mesh": ("usd", "--one-mesh"),
    "abc": ("abc",),
}
NEEDS = {"usd --one-mesh": "pxr", "abc": "alembic3d"}
TARGETS = {"gltf": 12.0, "vat": 20.0, "web": 15.0}
"""MB at most, of A010_cube in 120 frames."""


def main(names: list[str]) -> list[Target]:
    """Measure the shots of these names, by default SHOTS and a long one; return the targets."""
    forms = {name: words for name, words in FORMS.items() if name not in NEEDS or find_spec(NEEDS[name])}
    for name in FORMS.keys() - forms.keys():
        print(f"{name} is left out: module {NEEDS[name]} is not installed")
    rows: list[Row] = []
    for name in names or (LONG, *SHOTS):
        with tempfile.TemporaryDirectory() as folder:
            for row in measure(name, Path(folder), forms):
                rows.append(row)
                show("An export", [row])
    show("Exports of one mesh", rows)
    keep("exports", rows)
    show("MB for a million vertices in a frame", [_spread(form, rows) for form in forms])
    return [
        Target(LONG, f"{row['form']}, MB", float(row["MB"]), most=TARGETS[str(row["form"])])
        for row in rows
        if row["shot"] == LONG and row["form"] in TARGETS
    ]


def measure(name: str, root: Path, forms: dict[str, tuple[str, ...]]) -> Iterator[Row]:
    """Yield size and CPU seconds of each format of a shot."""
    copy_shots(root)
    shot = root / "shots" / f"{name.partition(' ')[0]}.yaml"
    if name == LONG:
        shot.write_text(slowed(shot.read_text(encoding="utf-8"), FRAMES), encoding="utf-8")
    source = SourceCache().source(shot, (), False)
    refining = _export(root, shot, root / "first", ("gltf",))
    request = RenderRequest(source, "draft", "none", tuple(source.manifest.frames))
    vertices = sum(len(Unification(part, Store(root)).one_mesh().rest) for part in request.parts)
    _export(root, shot, root / "first", ("web",))
    for form, words in forms.items():
        target = root / form.replace(" ", "")
        seconds = _export(root, shot, target, words)
        held = sum(file.stat().st_size for file in target.iterdir() if not file.name.endswith(".keys.json"))
        row: Row = {
            "shot": name,
            "form": form,
            "frames": len(request.requested),
            "vertices": vertices,
            "MB": held / 1e6,
        }
        yield row | {"CPU s": seconds, "refining, CPU s": refining - seconds if form == "gltf" else ""}


def slowed(text: str, frames: int) -> str:
    """Return a shot file at 24 frames a second with the same motion in more frames, at a higher rate."""
    last = int(re.findall(r"^frames: 1-(\d+)$", text, re.MULTILINE)[0])

    def spread(keys: re.Match[str]) -> str:
        return re.sub(
            r"(\d+):", lambda key: f"{1 + round((int(key[1]) - 1) * (frames - 1) / (last - 1))}:", keys[0]
        )

    text = re.sub(r"keys: \{[^}]*\}", spread, text).replace(f"frames: 1-{last}", f"frames: 1-{frames}")
    return text.replace("rate: 24", f"rate: {round(24 * (frames - 1) / (last - 1))}")


def _export(root: Path, shot: Path, folder: Path, words: tuple[str, ...]) -> float:
    """Run an export; return its CPU seconds. Raises CalledProcessError where it fails."""
    command = [CHECKOUT / ".venv/bin/flowsculpt", "--no-progress", "-j", "1", "export", words[0], shot.stem]
    return run([*command, *words[1:], "-o", folder], root, dict(os.environ)).processor


def _spread(form: str, rows: list[Row]) -> Row:
    """Return the worst shot and the best of a format, by bytes of a vertex in a frame."""
    sizes = {
        str(row["shot"]): 1e6 * float(row["MB"]) / (float(row["frames"]) * float(row["vertices"]))
        for row in rows
        if row["form"] == form
    }
    worst, best = max(sizes, key=sizes.__getitem__), min(sizes, key=sizes.__getitem__)
    return {"form": form, "worst": sizes[worst], "of": worst, "best": sizes[best], "at": best}


if __name__ == "__main__":
    show("Targets", [target.row for target in main(sys.argv[1:])])
