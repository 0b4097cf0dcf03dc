"""`python -m benchmarks.breeding`: how long `flowsculpt breed` takes, and what it leaves out.

One generation of each of four kinds of shots, 40 candidates on two cores, from the start of the process to
its end: a solid in velocity fields, a ball on an attractor, a cloud, and two subjects.
Wall seconds, and CPU seconds of all processes, which other work does not lengthen.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.report import Row, Target, keep, show

SHOTS = {
    "A010_cube": "cube in two vortices and a twist, 58 frames",
    "A020_lorenz": "ball on the Lorenz attractor, 60 frames",
    "B080_motes": "cloud of 20 thousand points, 220 frames",
    "B150_pair": "two blocks in a vortex, 192 frames",
}

CORES = 2


def cpu_seconds() -> float:
    """Return the CPU seconds of all processes that this one has started and waited for."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def bred(shot: Path) -> tuple[float, float, dict[str, int]]:
    """Breed a shot; return wall seconds, CPU seconds, and how many candidates were left out by the reason."""
    with tempfile.TemporaryDirectory() as folder:
        words = ["breed", str(shot), "-j", str(CORES), "--json", "--root", folder]
        command = [sys.executable, "-P", "-m", "flowsculpt", *words]
        began, used = time.perf_counter(), cpu_seconds()
        environment = {**os.environ, "NUMBA_NUM_THREADS": str(CORES)}
        answer = subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout
        facts = json.loads(answer)
        return time.perf_counter() - began, cpu_seconds() - used, facts["left_out"]


def main() -> None:
    """Measure and print all rows."""
    rows: list[Row] = []
    for name, what in SHOTS.items():
        wall, cpu, left_out = bred(Path("shots") / f"{name}.yaml")
        facts = {"shot": name, "what": what, "wall s": wall, "CPU s": cpu}
        rows.append({**facts, "left out": ", ".join(f"{why}: {count}" for why, count in left_out.items())})
        if name == "A010_cube":
            rows.append(Target("breed", "seconds, two cores", wall, most=180.0).row)
    show("Breeding", rows)
    keep("breeding", rows)


if __name__ == "__main__":
    main()
