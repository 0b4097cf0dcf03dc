"""`python -m benchmarks.copies [--render]`: rigid copies through `flowsculpt simulate`, and pictures of them.

Shots of 200, 1,000 and 5,000 copies, of a small mesh and of a large one, in a vortex and in curl noise, are
simulated for FRAMES frames and for one frame; the difference is the time of a frame. CPU seconds are those of
all processes, user and system; memory is the largest resident set of any of them, less that of one copy.
`--render` also renders one draft frame of each, with cryptomatte and motion vectors. Target for 1,000
copies: 0.05 CPU s a frame. Writes `benchmarks/out/copies.json`.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.first_film import CHECKOUT
from benchmarks.report import Row, Target, keep, show

FRAMES = 96
MOST = 0.05
"""CPU seconds of a frame of 1,000 copies."""

SHOT = """\
title: Copies
frames: 1-{frames}
subjects:
  drops:
    solid: icosphere
    radius: 0.05
    look: chrome
    copies: {{count: {count}, rigid: true, seed: 2, size: [0.4, 1], region: {{sphere: {{radius: 2}}}}}}
resample: {{max_edge_length: {edge}}}
flows:
  - {flow}
camera: {{azimuth: 20, distance: 9, target: [0, 0, 0]}}
layers: nuke
"""
FLOWS = {
    "vortex": "vortex: {axis: [0.2, 1, 0], strength: 2}",
    "curl noise": "curl_noise: {size: 1.2, strength: 0.6}",
}
EDGES = {"small": 0.03, "large": 0.004}
CASES = [
    (200, "small", "vortex"),
    (1000, "small", "vortex"),
    (1000, "small", "curl noise"),
    (1000, "large", "vortex"),
    (5000, "small", "curl noise"),
]


def main(render: bool) -> list[Target]:
    """Measure all cases; return the targets."""
    rows: list[Row] = []
    for count, mesh, flow in CASES:
        rows.append(measure(count, mesh, flow, render))
        show("Rigid copies", rows[-1:])
    keep("copies", rows)
    show("Rigid copies", rows)
    frames = {str(row["case"]): float(row["frame, CPU s"]) for row in rows}
    return [
        Target(f"copies:{name}", "CPU s", s, MOST) for name, s in frames.items() if name.startswith("1000")
    ]


def measure(count: int, mesh: str, flow: str, render: bool) -> Row:
    """Measure one case."""
    text = SHOT.format(frames=FRAMES, count=count, edge=EDGES[mesh], flow=FLOWS[flow])
    one = text.replace(f"count: {count},", "count: 1,")
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        first, _ = command(root / "a", text, "simulate", "-f", "1")
        whole, memory = command(root / "b", text, "simulate")
        _, alone = command(root / "c", one, "simulate")
        files = sorted((root / "b").glob("renders/shot/meshes/drops/*.npz"))
        row: Row = {
            "case": f"{count} {mesh}, {flow}",
            "vertices of one": vertices(files[-1]),
            "frame, CPU s": (whole - first) / (FRAMES - 1),
            "memory above one, MiB": memory - alone,
            "mesh file, kB": files[-1].stat().st_size / 1e3,
        }
        if render:
            spent, peak = command(root / "b", text, "render", "-f", str(FRAMES // 2))
            row |= {"picture, CPU s": spent, "its memory, MiB": peak}
    return row


def vertices(path: Path) -> int:
    """Return the number of vertices in a mesh file."""
    import numpy as np

    with np.load(path) as named:
        return len(named["vertices"])


def command(root: Path, text: str, name: str, *options: str) -> tuple[float, float]:
    """Run a command on a shot; return CPU seconds, and MiB of its largest process."""
    (root / "shots").mkdir(parents=True, exist_ok=True)
    path = root / "shots" / "shot.yaml"
    path.write_text(text)
    line = [CHECKOUT / ".venv/bin/flowsculpt", "--no-progress", "--root", root, "-j1", name, path, *options]
    words = [sys.executable, "-m", "benchmarks.copies", "--run", *map(str, line)]
    done = subprocess.run(words, capture_output=True, text=True, check=True, cwd=CHECKOUT)
    spent, peak = done.stdout.split()[-2:]
    return float(spent), float(peak)


def run_measured(words: list[str]) -> None:
    """Run a command line, and print its CPU seconds and the MiB of its largest process."""
    import resource

    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    subprocess.run(words, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    print(used.ru_utime + used.ru_stime, used.ru_maxrss / 1024)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--run"]:
        run_measured(sys.argv[2:])
    else:
        sys.exit(any(not target.met for target in main("--render" in sys.argv)))
