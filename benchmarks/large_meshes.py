"""`python -m benchmarks.large_meshes [KIND …] [COMMAND …] [--of FOLDER]`: commands at a million vertices.

For each kind of input, `flowsculpt simulate` makes six frames, `flowsculpt preview` draws them and
`flowsculpt render -q draft -f 1` renders the first, in a folder of their own. A row has the time by the clock
and the CPU time of all processes, and the peak memory of the largest process. Its excess over the same
command with a hundredth of the vertices, over the vertices, is what a vertex takes; the rest is Python and
the libraries. `--of` measures another checkout of the project. Writes `benchmarks/out/large_meshes.json`.
"""

from __future__ import annotations

import os
import resource
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
import psutil

from benchmarks.report import Row, keep, show

SHOT = """\
title: A large mesh in a pair of vortices
frames: 1-6
rate: 24
subject: {subject}
resample: {{max_edge_length: {edge}, max_vertices: 20000000{more}}}
flows:
  - sum:
      - vortex: {{axis: z, centre: [0.9, 0.3, 0], radius: 0.8, strength: 7.6}}
      - vortex: {{axis: z, centre: [-0.9, 0.3, 0], radius: 0.8, strength: -7.6}}
      - translation: {{rate: [0, 1.07, 0]}}
look: clay
"""

KINDS = {
    "cube": ("{solid: box, size: [2, 2, 2]}", 0.0083, ""),
    "cube, rest renewed": ("{solid: box, size: [2, 2, 2]}", 0.0083, ", rest_interval: 2"),
    "ball": ("{solid: icosphere}", 0.0035, ""),
    "torus, chord": ("{solid: torus}", 0.0064, ", placement: chord"),
    "sheet, curved": ("{solid: sheet}", 0.0034, ", placement: curved"),
}
"""Subject, maximum edge length, and further settings of the resampling."""

SMALLER = 10.0
"""The edges of the small mesh are so many times as long."""

COMMANDS = (("simulate",), ("preview",), ("render", "-q", "draft", "-f", "1"))

INTERVAL = 0.005
"""Seconds between two looks at the memory of all processes."""


def main(kinds: Sequence[str], commands: Sequence[Sequence[str]], checkout: Path) -> None:
    """Measure the kinds and print the rows."""
    rows = [row for kind in kinds for row in measure(kind, commands, checkout)]
    keep("large_meshes", rows)
    show("Commands at a million vertices", rows)


def measure(kind: str, commands: Sequence[Sequence[str]], checkout: Path) -> Iterator[Row]:
    """Yield a row for each command; the first one simulates."""
    subject, edge, more = KINDS[kind]
    with tempfile.TemporaryDirectory() as folder:
        shots = Path(folder) / "shots"
        shots.mkdir()
        for name, length in (("small", SMALLER * edge), ("large", edge)):
            (shots / f"{name}.yaml").write_text(SHOT.format(subject=subject, edge=length, more=more))
        for command in commands:
            small = run(checkout, Path(folder), command, "small")
            large = run(checkout, Path(folder), command, "large")
            files = sorted(Path(folder, "renders/large/meshes").glob("*.npz"))
            with np.load(files[-1]) as last:
                vertices = len(last["vertices"])
            yield {
                "kind": kind,
                "command": " ".join(command),
                "vertices": float(vertices),
                "s": large["s"],
                "CPU s": large["CPU s"],
                "peak MB": large["peak MB"],
                "bytes a vertex": 1e6 * (large["peak MB"] - small["peak MB"]) / vertices,
                "MB a frame": float(np.mean([file.stat().st_size for file in files])) / 1e6,
            }


def run(checkout: Path, root: Path, command: Sequence[str], shot: str) -> dict[str, float]:
    """Run a command for a shot; return its seconds, CPU seconds and the peak of its largest process."""
    words = [sys.executable, "-m", "flowsculpt", *command, shot, "--no-progress"]
    started, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    process = psutil.Popen(words, cwd=root, env=os.environ | {"PYTHONPATH": str(checkout)}, stdout=2)
    peak = 0
    while process.poll() is None:
        with suppress(psutil.Error):
            for one in (process, *process.children(recursive=True)):
                with suppress(psutil.Error):
                    peak = max(peak, one.memory_info().rss)
        time.sleep(INTERVAL)
    if process.returncode:
        sys.exit(f"{' '.join(words)} ended with {process.returncode}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {"s": time.perf_counter() - started, "CPU s": spent, "peak MB": peak / 1e6}


if __name__ == "__main__":
    given = sys.argv[1:]
    of = Path(given[given.index("--of") + 1]) if "--of" in given else Path(__file__).parent.parent
    chosen = [command for command in COMMANDS if command[0] in given]
    main([kind for kind in given if kind in KINDS] or list(KINDS), chosen or COMMANDS, of.resolve())
