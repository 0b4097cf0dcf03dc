"""Benchmarks are run seldom, and lean on all of the project: what they lean on is there."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

HOME = Path(__file__).parents[1]
APART = {"__main__", "blender"}
"""What runs them all, and what Blender runs."""


def test_every_benchmark_finds_what_it_measures() -> None:
    names = sorted(file.stem for file in (HOME / "benchmarks").glob("*.py") if file.stem not in APART)
    code = f"import importlib\nfor name in {names}: importlib.import_module(f'benchmarks.{{name}}')"
    done = subprocess.run([sys.executable, "-c", code], cwd=HOME, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-800:]
