"""`python -m benchmarks.start [--before DIR] [--runs]`: what a machine spends before and around its frames.

CPU seconds of commands and of all processes that they start, by this code and by another checkout, DIR:

    kernels, cold        `doctor --prepare` with an empty cache
    kernels, shipped     the same on a node that finds them in a remote store, here a folder
    start of simulate    `task plan.json simulate` of a shot of two frames, kernels compiled: medians
    --version, --help    medians
    flows, schema, new   medians
    validate             of the same shot, which has not changed: median
    Tab                  what completes `render st`: median, of the checkouts that complete
    status               of the same shot, rendered: median
    validate, gallery    of all shots and edits that come with flowsculpt, unchanged: median
    simulate, one frame; render, one frame; render, 8 daily frames
                         in a new root each time, of the same shot: medians
    render, nothing to be done
                         after one frame: median

With `--runs` all but the first two, with the kernels of the user's cache. Compiled modules of Python are
kept, as by set-up. Writes `benchmarks/out/start.json`.
"""

from __future__ import annotations

import math
import os
import shutil
import statistics
import tempfile
from argparse import ArgumentParser
from collections.abc import Callable
from itertools import count
from pathlib import Path

import platformdirs

from benchmarks.report import Row, Target, keep, show

CHECKOUT = Path(__file__).parents[1]

REPEATS, RUNS = 7, 3
"""Times that a start, and a run, is measured."""

SHORT = {"flows": 0.5, "schema": 0.5, "new": 0.5, "validate": 0.6, "validate, gallery": 3.0, "Tab": 0.1}
"""CPU seconds that commands take at most."""

RUN = {
    "simulate, one frame": ("simulate", "start", "-f", "1"),
    "render, one frame": ("render", "start", "-f", "1"),
    "render, 8 daily frames": ("render", "start", "-f", "1-8", "-q", "daily"),
}
"""Commands that are measured in a new root."""

SHOT = """
title: Start
frames: 1-8
subject: {solid: box, size: [2, 2, 2]}
resample: {max_edge_length: 0.075}
flows:
  - sum:
      - vortex: {axis: z, centre: [0.9, 0.3, 0], radius: 0.8, strength: 5}
      - translation: {rate: [0, 1, 0]}
  - twist: {axis: y, amount: {keys: {1: 0, 2: 10}}}
"""


class Tree:
    """A checkout, with a folder of its own for a cache, its compiled modules and a show."""

    def __init__(self, checkout: Path, folder: Path) -> None:
        self._command = checkout / ".venv/bin/flowsculpt"
        self.folder = folder
        (folder / "shots").mkdir(parents=True)
        (folder / "shots/start.yaml").write_text(SHOT)
        shutil.copytree(CHECKOUT / "shots", folder / "gallery/shots")
        self._completes = (checkout / "pipeline/plugins/completion").exists()
        self._numbers = count(1)

    def use_kernels(self) -> None:
        """Use the compiled kernels of the user's cache."""
        (self.folder / "cache/flowsculpt").mkdir(parents=True)
        for known in platformdirs.user_cache_path("flowsculpt").glob("*"):
            if known.name != "planning":
                (self.folder / "cache/flowsculpt" / known.name).symlink_to(known)

    def seconds(self, *words: str, cache: str = "cache", folder: str = ".", **variables: str) -> float:
        """Return the CPU seconds of a command and its processes, with a cache of a name.

        folder, variables  where it works, and environment variables that it gets
        """
        environment = {
            **{k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "FLOWSCULPT"))},
            "XDG_CACHE_HOME": str(self.folder / cache),
            "PYTHONPYCACHEPREFIX": str(self.folder / "modules"),
            **variables,
        }
        line = [
            "sh",
            "-c",
            'cd "$0" && exec "$@" >/dev/null',
            str(self.folder / folder),
            str(self._command),
            *words,
        ]
        process = os.posix_spawnp("sh", line, environment)
        _, status, usage = os.wait4(process, 0)
        assert status == 0, words
        return usage.ru_utime + usage.ru_stime

    def in_new_root(self, *words: str) -> float:
        """Return the CPU seconds of a command in a new root."""
        shutil.rmtree(self.folder / "root", ignore_errors=True)
        (self.folder / "root").mkdir()
        return self.seconds("--root", "root", *words)

    def starts(self) -> dict[str, Callable[[], float]]:
        """Return the measurements of starts. Those of a root come after one frame was rendered there."""
        return {
            "start of simulate": lambda: self.in_new_root("task", "plan.json", "simulate"),
            "--version": lambda: self.seconds("--version"),
            "--help": lambda: self.seconds("--help"),
            "flows": lambda: self.seconds("flows"),
            "schema": lambda: self.seconds("schema"),
            "new": lambda: self.seconds("new", f"N{next(self._numbers):03}"),
            "validate": lambda: self.seconds("validate", "start"),
            "Tab": lambda: (
                self.seconds("render", "st", _FLOWSCULPT_COMPLETE="bash") if self._completes else math.nan
            ),
        }

    def runs(self) -> dict[str, Callable[[], float]]:
        """Return the measurements of runs, those in a root that was rendered to first."""
        done = {
            "render, nothing to be done": lambda: self.seconds("--root", "root", *RUN["render, one frame"]),
            "status": lambda: self.seconds("--root", "root", "status"),
            "validate, gallery": lambda: self.seconds("validate", folder="gallery"),
        }
        new = {what: lambda words=words: self.in_new_root(*words) for what, words in RUN.items()}
        return {"render, one frame": new.pop("render, one frame"), **done, **new}


def main(before: Path | None = None, all_kernels: bool = True) -> list[Target]:
    """Measure both checkouts; return the targets, where there are two."""
    measured: dict[str, list[float]] = {}
    with tempfile.TemporaryDirectory() as name:
        trees = [Tree(CHECKOUT, Path(name, "now"))]
        trees += [Tree(before, Path(name, "before"))] if before is not None else []
        for tree in trees:
            if not all_kernels:
                tree.use_kernels()
            tree.seconds("export", "plan", "start", "-f", "1-2")  # loads the disk's cache, writes modules
        if all_kernels:
            measured = _kernels(trees, Path(name, "store"))
        for tree in trees:
            for measure in {**tree.starts(), **tree.runs()}.values():
                measure()
        measured |= _medians([tree.starts() for tree in trees], REPEATS)
        measured |= _medians([tree.runs() for tree in trees], RUNS)
    rows: list[Row] = []
    for what, (now, *others) in measured.items():
        rows.append({"what": what, "CPU s": now})
        if others:
            rows[-1] |= {"before": others[0], "share": now / others[0]}
    show("Before the first frame", rows)
    keep("start", rows)
    if before is None:
        return []
    most = {"kernels, cold": 0.65, "kernels, shipped": 0.05, "--version": 1.03, "--help": 1.03}
    return [
        Target(
            str(row["what"]),
            "CPU seconds, of before",
            float(row["share"]),
            most=most.get(str(row["what"]), 1.05),
        )
        for row in rows
        if row["what"] != "Tab"
    ] + [
        Target(
            what, "CPU seconds", next(float(row["CPU s"]) for row in rows if row["what"] == what), most=most
        )
        for what, most in SHORT.items()
    ]


def _kernels(trees: list[Tree], store: Path) -> dict[str, list[float]]:
    """Return what compiling all kernels takes, and what a node takes that finds them; all trees keep them."""
    cold = [tree.seconds("doctor", "--prepare", cache="cold") for tree in trees]
    store.mkdir()
    now = trees[0]
    now.seconds("--store", str(store), "doctor", "--prepare", cache="cold")
    shipped = now.seconds("--store", str(store), "doctor", "--prepare", cache="node")
    for tree in trees:
        shutil.rmtree(tree.folder / "cache", ignore_errors=True)
        (tree.folder / "cold").rename(tree.folder / "cache")
    return {"kernels, cold": cold, "kernels, shipped": [shipped, *cold[1:]]}


def _medians(calls: list[dict[str, Callable[[], float]]], repeats: int) -> dict[str, list[float]]:
    """Return the median of each measurement by each tree, made in turns."""
    turns = [[{what: call() for what, call in of_tree.items()} for of_tree in calls] for _ in range(repeats)]
    return {
        what: [statistics.median(turn[tree][what] for turn in turns) for tree in range(len(calls))]
        for what in calls[0]
    }


if __name__ == "__main__":
    parser = ArgumentParser()
    parser.add_argument("--before", type=Path)
    parser.add_argument("--runs", action="store_true")
    given = parser.parse_args()
    if targets := main(given.before, not given.runs):
        show("Targets", [target.row for target in targets])
