"""Benchmarks run seldom and import much of the project: what they import is there."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks import same_results
from flowsculpt.render.post.image import write_png
from tests.needed_plugins import OF_PLUGIN, missing

HOME = Path(__file__).parents[1]
APART = {"__main__", "blender"}
"""What runs them all, and what Blender runs."""


@pytest.mark.slow
def test_every_benchmark_finds_what_it_measures():
    files = [file for file in (HOME / "benchmarks").glob("*.py") if file.stem not in APART]
    names = sorted(file.stem for file in files if not missing(*OF_PLUGIN.findall(file.read_text())))
    code = f"import importlib\nfor name in {names}: importlib.import_module(f'benchmarks.{{name}}')"
    done = subprocess.run([sys.executable, "-c", code], cwd=HOME, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-800:]


@pytest.fixture
def two_roots(tmp_path):
    """Two roots with one mesh and one picture each, the same in both."""
    roots = [tmp_path / "one", tmp_path / "other"]
    for root in roots:
        home = root / "renders" / "shot"
        home.mkdir(parents=True)
        np.savez(home / "shot.0001.npz", vertices=np.eye(3), faces=np.int32([[0, 1, 2]]))
        write_png(home / "shot.0001.png", np.full((4, 6, 3), 7, np.uint8))
    return roots


def test_equal_results_of_two_roots_are_told_as_the_same(two_roots, capsys):
    assert same_results.main(*two_roots) == 0
    assert capsys.readouterr().out == "the same: 1 meshes, 1 pictures\n"


def test_a_result_that_differs_or_is_missing_is_named(two_roots, capsys):
    home = two_roots[1] / "renders" / "shot"
    write_png(home / "shot.0001.png", np.full((4, 6, 3), 8, np.uint8))
    (home / "shot.0001.npz").unlink()
    assert same_results.main(*two_roots) == 1
    told = capsys.readouterr().out
    assert "differs: renders/shot/shot.0001.png" in told
    assert f"only in {two_roots[0]}: renders/shot/shot.0001.npz" in told
