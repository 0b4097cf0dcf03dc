"""`python -m benchmarks.start [--before DIR]`: what a machine spends before its first frame.

CPU seconds of commands and of all processes that they start, by this code and by another checkout, DIR:

    kernels, cold        `doctor --prepare` with an empty cache
    kernels, shipped     the same on a node that finds them in a remote store, here a folder
    start of simulate    `task plan.json simulate` of a shot of two frames, kernels compiled: medians
    --version, --help    medians

Compiled modules of Python are kept, as by set-up. Writes `benchmarks/out/start.json`.
"""

from __future__ import annotations

import os
import shutil
import statistics
import tempfile
from argparse import ArgumentParser
from pathlib import Path

from benchmarks.report import Row, Target, keep, show

CHECKOUT = Path(__file__).parents[1]

REPEATS = 7

SHOT = """
title: Start
frames: 1-2
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

    def seconds(self, *words: str, cache: str = "cache") -> float:
        """Return the CPU seconds of a command and its processes, with a cache of a name."""
        environment = {
            **{k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "FLOWSCULPT"))},
            "XDG_CACHE_HOME": str(self.folder / cache),
            "PYTHONPYCACHEPREFIX": str(self.folder / "modules"),
        }
        line = ["sh", "-c", 'cd "$0" && exec "$@" >/dev/null', str(self.folder), str(self._command), *words]
        process = os.posix_spawnp("sh", line, environment)
        _, status, usage = os.wait4(process, 0)
        assert status == 0, words
        return usage.ru_utime + usage.ru_stime

    def simulate(self) -> float:
        """Return the CPU seconds of a task that simulates two frames in a new root."""
        shutil.rmtree(self.folder / "root", ignore_errors=True)
        (self.folder / "root").mkdir()
        return self.seconds("--root", "root", "task", "plan.json", "simulate")


def main(before: Path | None = None) -> list[Target]:
    """Measure both checkouts; return the targets, where there are two."""
    with tempfile.TemporaryDirectory() as name:
        trees = [Tree(CHECKOUT, Path(name, "now"))]
        trees += [Tree(before, Path(name, "before"))] if before is not None else []
        for tree in trees:
            tree.seconds("export", "plan", "start")  # writes the compiled modules, and loads the disk's cache
        kernels = [tree.seconds("doctor", "--prepare", cache="cold") for tree in trees]
        store = Path(name, "store")
        store.mkdir()
        shipped: list[float] = []
        for tree in trees[:1]:
            tree.seconds("--store", str(store), "doctor", "--prepare", cache="cold")
            shipped.append(tree.seconds("--store", str(store), "doctor", "--prepare", cache="node"))
        for tree in trees:
            (tree.folder / "cold").rename(tree.folder / "cache-of-kernels")
            shutil.rmtree(tree.folder / "cache", ignore_errors=True)
            (tree.folder / "cache-of-kernels").rename(tree.folder / "cache")
            tree.simulate()
        starts = {
            "start of simulate": [tree.simulate for tree in trees],
            "--version": [lambda tree=tree: tree.seconds("--version") for tree in trees],
            "--help": [lambda tree=tree: tree.seconds("--help") for tree in trees],
        }
        measured = {"kernels, cold": kernels, "kernels, shipped": [shipped[0], *kernels[1:]]}
        for what, calls in starts.items():
            turns = [[call() for call in calls] for _ in range(REPEATS)]
            measured[what] = [statistics.median(times) for times in zip(*turns, strict=True)]
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
            most=most.get(str(row["what"]), 1.0),
        )
        for row in rows
    ]


if __name__ == "__main__":
    parser = ArgumentParser()
    parser.add_argument("--before", type=Path)
    if targets := main(parser.parse_args().before):
        show("Targets", [target.row for target in targets])
