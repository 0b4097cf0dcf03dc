"""The library, `import flowsculpt`: its public names, and what importing it costs and changes."""

from __future__ import annotations

import pickle
import re
import subprocess
import sys
from collections.abc import Callable
from copy import deepcopy
from importlib.util import find_spec
from inspect import getdoc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flowsculpt
from flowsculpt import api, render
from flowsculpt.pipeline import flow, mesh, resample, shot
from flowsculpt.pipeline.flow.composition import Sum, within
from flowsculpt.pipeline.flow.regions import ClosedSurface, MeshRegion
from flowsculpt.pipeline.plugins.fields.attraction import Attraction, Target, Wind
from flowsculpt.pipeline.plugins.fields.formula_field import FormulaField
from tests.needed_plugins import SHIPPED, needs_plugins


@pytest.mark.parametrize("name", flowsculpt.__all__)
def test_each_public_name_is_there_with_a_docstring_of_its_own(name: str) -> None:
    """Enough for `help`, and for the API page of the site, which is made of these docstrings."""
    public = getattr(flowsculpt, name)
    assert public.__name__ == name and vars(public).get("__doc__", public.__doc__)
    assert len(getdoc(public) or "") >= 40


MODULES = [flowsculpt, flow, mesh, resample, shot, render, api]


@pytest.mark.parametrize("module", MODULES, ids=lambda module: module.__name__)
def test_readers_of_types_see_the_names_that_python_has(module: Any) -> None:
    seen: dict[str, object] = {}
    exec(Path(f"{module.__file__}i").read_text(encoding="utf-8"), seen)
    assert sorted(seen.keys() - {"__builtins__", "__doc__"}) == module.__all__
    assert all(seen[name] is getattr(module, name) for name in module.__all__)


def test_editors_complete_the_public_names() -> None:
    assert set(flowsculpt.__all__) <= set(dir(flowsculpt))


def test_a_name_that_is_not_there_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="module 'flowsculpt' has no attribute 'Resample'"):
        _ = flowsculpt.Resample  # type: ignore[attr-defined]


def test_a_name_of_a_plug_in_that_is_missing_is_refused_by_one_sentence(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    plugin = "flowsculpt.pipeline.plugins.interchange"
    monkeypatch.setitem(sys.modules, plugin, None)
    monkeypatch.delitem(sys.modules, f"{plugin}.mesh_writers", raising=False)
    with pytest.raises(ImportError) as refused:
        exec("from flowsculpt import write_mesh")
    assert str(refused.value) == "flowsculpt.write_mesh needs the plug-in interchange, which is not installed"


BALL = flowsculpt.icosphere(4).with_attributes(heat=np.arange(162.0)).with_creases([[0, 1]])


@pytest.mark.parametrize("duplicate", [deepcopy, lambda value: pickle.loads(pickle.dumps(value))])
def test_values_and_resamplers_go_to_other_processes(duplicate: Callable[[Any], Any]) -> None:
    """Pools pickle them; flows after they were used here, with what kernels know by address."""
    polygons = flowsculpt.PolygonMesh.from_triangles(BALL)
    for surface in BALL, polygons:
        ours, theirs = vars(surface), vars(duplicate(surface))
        np.testing.assert_equal(
            {**theirs, "attributes": dict(theirs["attributes"])},
            {**ours, "attributes": dict(ours["attributes"])},
        )
    texture = flowsculpt.TextureCoordinates(BALL.vertices, BALL.faces, BALL.vertices[:, :2])
    resampler = flowsculpt.Resampler(texture.prepare(BALL), flowsculpt.Thresholds(0.3))
    again = duplicate(resampler)
    assert again.resample() == duplicate(resampler.resample())
    np.testing.assert_equal(again.state(), resampler.state())
    one, other = (value.split(resampler.mesh) for value in (texture, duplicate(texture)))
    np.testing.assert_equal(dict(one.attributes), dict(other.attributes))


@pytest.mark.parametrize("duplicate", [deepcopy, lambda value: pickle.loads(pickle.dumps(value))])
def test_flows_that_were_used_go_to_other_processes(duplicate: Callable[[Any], Any]) -> None:
    field = Sum(
        (FormulaField(("y", "x", "1")), Attraction(Target.points(np.eye(3))), Wind(((0, 0, 0), (1, 0, 0))))
    )
    turn = flowsculpt.Twist(amount=flowsculpt.keyed((0, 1), (0, 2)))
    surface = ClosedSurface.of(flowsculpt.box())
    flow = flowsculpt.Sequence((flowsculpt.Streamlines(field), within(turn, MeshRegion(surface=surface))))
    moved = flow.displace(BALL.vertices, 0.0, 0.1)
    assert duplicate(flow) == flow
    np.testing.assert_array_equal(duplicate(flow).displace(BALL.vertices, 0.0, 0.1), moved)


IMPORT = """
import os, sys
before, settings, path = set(sys.modules), dict(os.environ), list(sys.path)
import flowsculpt
heavy = {"numpy", "numba"}
print(sorted(name for name in set(sys.modules) - before if name.partition(".")[0] in {"flowsculpt", *heavy}))
print(settings == dict(os.environ), path == sys.path)
"""


def test_importing_the_library_imports_no_module_and_sets_no_variable() -> None:
    done = subprocess.run([sys.executable, "-c", IMPORT], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["['flowsculpt']", "True True"]


ALONE = """
import sys
BASE = {"flowsculpt", "numpy", "numba", "llvmlite", "platformdirs", *sys.stdlib_module_names}

class OnlyBase:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] not in BASE:
            raise ModuleNotFoundError(f"{name} is not installed", name=name)

sys.meta_path.insert(0, OnlyBase())
import flowsculpt
for name in flowsculpt.__all__:
    getattr(flowsculpt, name)
for suffix in ("ply", "obj", "off", "stl", "glb"):
    flowsculpt.write_mesh(flowsculpt.icosphere(4), f"a.{suffix}")
    assert flowsculpt.validate(flowsculpt.read_mesh(f"a.{suffix}")).closed
sculpture = flowsculpt.Resampler(flowsculpt.read_mesh("a.obj"), flowsculpt.Thresholds(0.3))
flow = flowsculpt.Sequence((flowsculpt.Streamlines(flowsculpt.Vortex()), flowsculpt.Stretch(amount=1.2)))
sculpture.vertices[:] = flow.displace(sculpture.vertices, 0.0, 0.1)
print(sculpture.resample().splits)
"""


@needs_plugins(*SHIPPED)
def test_meshes_flows_and_files_need_no_package_of_films(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", ALONE], capture_output=True, text=True, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "") and int(done.stdout) > 100


def test_the_examples_of_the_page_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    page = Path(__file__).parents[1] / "docs" / "library.md"
    blocks = re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    names: dict[str, Any] = {}
    for block in blocks:
        if "import pyvista" not in block or find_spec("pyvista"):  # half a gigabyte
            exec(block, names)
    assert flowsculpt.validate(flowsculpt.read_mesh("even.ply")).closed
    assert len(names["moved"].faces) > len(names["model"].faces)
    assert len(blocks) == 4
