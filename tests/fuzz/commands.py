"""Damaged files through the real command line: `python -m tests.fuzz.commands 100`."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import NamedTuple

from tests.fuzz.mutations import mutated
from tests.fuzz.samples import samples

_SHOT = "title: a\nframes: 1-2\n"
_BOX = "subject: {solid: box}\nresample: {max_edge_length: 0.5}\n"

SHOTS = {
    "model": _SHOT + "subject: {model: FILE, fit: 2}\nresample: {max_edge_length: 0.5}\n",
    "scene": _SHOT + "subject: {model: FILE, fit: 2}\nresample: {max_edge_length: 0.5}\n",
    "stage": _SHOT + "subject: {model: FILE, fit: 2}\nresample: {max_edge_length: 0.5}\n",
    "points": _SHOT + "subject: {cloud: FILE}\n",
    "net": _SHOT + "subject: {net: FILE, columns: 4}\n",
    "field": _SHOT + _BOX + "flows: [{sampled: {file: FILE}}]\n",
    "picture": _SHOT + _BOX + "look: {material: clay, colour: FILE}\n",
    "sky": _SHOT + _BOX + "lights: {hdri: FILE}\n",
    "view": _SHOT + _BOX + "view: {config: FILE, space: LINEAR}\n",
    "flow": _SHOT + _BOX + "flows: [{python: {file: FILE, function: move}}]\n",
    "sound": "title: a\nshots: [box]\nsound: FILE\n",
}
"""Shot files that name a file, and for sound an edit, by the kind of file."""


class Outcome(NamedTuple):
    """seconds of CPU; megabytes at the peak; words: stdout and stderr."""

    code: int
    words: str
    seconds: float
    megabytes: float

    @property
    def fault(self) -> str:
        """The fault in the end of a command; empty where there is none."""
        if "Traceback" in self.words or self.code not in (0, 2, 3):
            return f"exit code {self.code}"
        if len(self.words) > 3000:
            return "many words"
        return "slow" if self.seconds > 8.0 else "memory" if self.megabytes > 900 else ""


def validate(kind: str, path: Path) -> Outcome:
    """Run `flowsculpt validate` on a shot, or an edit, that names a file beside it."""
    folder = path.parent
    (folder / "box.yaml").write_text(_SHOT + _BOX)
    shot = folder / ("film.yaml" if kind == "sound" else "shot.yaml")
    shot.write_text(SHOTS[kind].replace("FILE", path.name))
    with tempfile.TemporaryFile() as output:
        process = subprocess.Popen(
            [sys.executable, "-m", "flowsculpt", "validate", str(shot)],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
        )
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        output.seek(0)
        words = output.read().decode("utf-8", "replace")
    return Outcome(process.returncode, words, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024)


def outcomes(seed: int, folder: Path) -> Iterator[tuple[str, bytes, Outcome]]:
    """Yield name, content and outcome of mutated files, without end, all samples in turn."""
    random = Random(seed)
    known = samples(folder / "samples")
    tried = folder / "tried"
    tried.mkdir()
    while True:
        for sample in known:
            content = mutated(sample.path.read_bytes(), random)
            (tried / sample.path.name).write_bytes(content)
            yield sample.path.name, content, validate(sample.kind, tried / sample.path.name)


def main() -> None:
    """Try files; print what went wrong, and the largest figures."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("count", type=int, nargs="?", default=100)
    arguments.add_argument("--seed", type=int, default=0)
    chosen = arguments.parse_args()
    codes: dict[int, int] = {}
    slowest = largest = (0.0, "")
    with tempfile.TemporaryDirectory() as folder:
        for number, (name, content, outcome) in enumerate(outcomes(chosen.seed, Path(folder)), 1):
            codes[outcome.code] = codes.get(outcome.code, 0) + 1
            slowest = max(slowest, (outcome.seconds, name))
            largest = max(largest, (outcome.megabytes, name))
            if outcome.fault:
                print(f"{name}: {outcome.fault}\n{content[:300]!r}\n{outcome.words[-3000:]}", flush=True)
            if number >= chosen.count:
                break
    print(f"exit codes {codes}, slowest {slowest[0]:.1f} s ({slowest[1]})")
    print(f"largest {largest[0]:.0f} MiB ({largest[1]})")


if __name__ == "__main__":
    main()
