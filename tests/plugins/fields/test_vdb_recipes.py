"""The recipes of docs/fields.md turn VDB files into the velocity fields that they hold."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.arrays import Points
from flowsculpt.pipeline.flow.catalogue.sampled_field import Samples
from flowsculpt.pipeline.plugins.fields.grid_files import read_samples

BLENDER = Path(os.environ.get("BLENDER_MODULE", Path(sys.prefix) / "cycles"))
PAGE = Path(__file__).parents[3] / "docs" / "fields.md"

GRADIENT = np.array([[0.5, -1.0, 2.0], [1.5, 0.25, -0.75], [-2.0, 1.0, 0.125]])
"""Of the velocity of every file: exact in float32, and linear, so that means of faces are exact."""

WRITER = """\
import sys
import numpy as np, openvdb as vdb
folder, kind, gradient = sys.argv[1], sys.argv[2], np.array(eval(sys.argv[3]))
for frame in range(3):
    grid = vdb.Vec3SGrid((0.0, 0.0, 0.0))
    grid.name, grid.transform = "velocity", vdb.createLinearTransform(0.25)
    grid.transform.postTranslate((1.0, 2.0, -3.0))
    low, shape = (-frame, 2, 1), (6 + frame, 7, 8)  # a box that grows
    at = np.stack(np.meshgrid(*(np.arange(a, a + n) for a, n in zip(low, shape)), indexing="ij"), axis=-1)
    values = np.zeros((*shape, 3), np.float32)
    for axis in range(3):
        offset = np.eye(3)[axis] * (-0.5 if kind == "staggered" else 0.0)
        values[..., axis] = ((0.25 * (at + offset) + (1.0, 2.0, -3.0)) @ gradient[axis]) * (frame + 1)
    grid.copyFromArray(values, ijk=low)
    if kind == "staggered":
        grid.gridClass = vdb.GridClass.STAGGERED
    vdb.write(f"{folder}/fluid_{frame:04d}.vdb", grids=[grid])
"""

HOUDINI = '''\
"""Stands in for hou: grids in .npz, sampled between the middles of voxels, by the names of its manual."""
import numpy as np

class Box:
    def __init__(self, low, high): self.low, self.high = low, high
    def minvec(self): return self.low
    def maxvec(self): return self.high

class VDB:
    def __init__(self, name, origin, shift, low, values):
        self.name, self.origin, self.shift, self.low, self.values = name, origin, shift, low, values
    def attribValue(self, name): return self.name
    def activeVoxelBoundingBox(self): return Box(self.low, self.low + np.array(self.values.shape[:3]) - 1.0)
    def voxelSize(self): return (0.25, 0.25, 0.25)
    def indexToPos(self, at): return tuple(0.25 * (np.array(at) + self.shift) + self.origin)
    def samplev(self, at):
        place = (np.array(at) - self.origin) / 0.25 - self.shift - self.low
        i = np.clip(np.floor(place).astype(int), 0, np.array(self.values.shape[:3]) - 2)
        w, total = place - i, 0.0
        for corner in np.ndindex(2, 2, 2):
            weight = np.prod([w[a] if corner[a] else 1 - w[a] for a in range(3)])
            total = total + weight * self.values[tuple(i + corner)]
        return total
    sample = samplev

class Geometry:
    def loadFromFile(self, file):
        with np.load(file) as f:
            self.grids = [VDB(n, f["origin"], f[n + "/shift"], f["low"], f[n]) for n in f["names"]]
    def prims(self): return self.grids
'''


def recipe(program: str) -> str:
    """Return the code of the page's recipe that imports a module, at most 15 lines."""
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    (code,) = (block for block in blocks if program in block.split("\n")[0])
    assert len([line for line in code.splitlines() if line]) <= 15
    return str(code)


def run(folder: Path, name: str, code: str, *words: str, path: str) -> None:
    (folder / name).write_text(code)
    command = [sys.executable, "-P", str(folder / name), *words]
    done = subprocess.run(command, env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def require_field(samples: Samples, up: str) -> None:
    """Check that samples within the first box are those of the gradient, at each of three times."""
    axes = [axis[2:-1] for axis in samples.axes]
    places: Points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    turned = places if up == "y" else places[..., [0, 2, 1]] * (1.0, -1.0, 1.0)
    for time in range(3):
        read = samples.velocity[time, 2:-1, 2:-1, 2:-1]
        back = read if up == "y" else read[..., [0, 2, 1]] * (1.0, -1.0, 1.0)
        assert np.allclose(back, (turned @ GRADIENT.T) * (time + 1), rtol=1e-6, atol=1e-5)


@pytest.mark.soak
@pytest.mark.skipif(not (BLENDER / "bpy").is_dir(), reason="Blender is not there: make blender")
@pytest.mark.parametrize("kind", ["collocated", "staggered"])
def test_grids_of_blender_become_the_same_field(tmp_path: Path, kind: str) -> None:
    (modules,) = BLENDER.glob("bpy/*/python/lib/python3.*/site-packages")
    run(tmp_path, "write.py", WRITER, str(tmp_path), kind, str(GRADIENT.tolist()), path=str(modules))
    files = [str(file) for file in sorted(tmp_path.glob("fluid_*.vdb"))]
    target = tmp_path / "wind.npz"
    run(tmp_path, "vdb_field.py", recipe("openvdb"), "--", "24", str(target), *files, path=str(modules))
    samples = read_samples((target,)).samples
    assert samples.velocity.shape == (3, 8, 8, 7, 3)  # the union of the boxes, with y up
    assert samples.times == pytest.approx([0.0, 1.0 / 24.0, 2.0 / 24.0])
    assert samples.axes[0][[0, -1]] == pytest.approx([0.5, 2.25])
    assert samples.axes[1][[0, -1]] == pytest.approx([-2.75, -1.0])  # z of the file
    assert samples.axes[2][[0, -1]] == pytest.approx([-4.0, -2.5])  # −y of the file
    require_field(samples, up="z")


@pytest.mark.parametrize("grids", ["vel", "vel.x vel.y vel.z"])
def test_grids_of_houdini_become_the_same_field(tmp_path: Path, grids: str) -> None:
    (tmp_path / "hou.py").write_text(HOUDINI)
    names = grids.split()
    for frame in range(3):
        low, shape = np.array([-frame, 2, 1]), (6 + frame, 7, 8)
        arrays = {"names": np.array(names), "origin": np.array([1.0, 2.0, -3.0]), "low": low}
        for number, name in enumerate(names):
            shift = -0.5 * np.eye(3)[number] if len(names) == 3 else np.zeros(3)
            at = np.stack(np.meshgrid(*map(np.arange, low, low + shape), indexing="ij"), axis=-1)
            values = ((0.25 * (at + shift) + arrays["origin"]) @ GRADIENT.T) * (frame + 1)
            arrays |= {name: values if len(names) == 1 else values[..., number], f"{name}/shift": shift}
        np.savez(tmp_path / f"smoke.{frame:04d}.npz", **arrays)
    files = [str(file) for file in sorted(tmp_path.glob("smoke.*.npz"))]
    target = tmp_path / "wind.npz"
    run(tmp_path, "vdb_field.py", recipe("hou"), "24", str(target), *files, path=str(tmp_path))
    samples = read_samples((target,)).samples
    assert samples.times == pytest.approx([0.0, 1.0 / 24.0, 2.0 / 24.0])
    require_field(samples, up="y")
