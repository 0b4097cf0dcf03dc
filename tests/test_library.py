"""The library, `import flowsculpt`: its public names, and what importing it costs and changes."""

from __future__ import annotations

import re
import subprocess
import sys
from importlib.util import find_spec
from inspect import getdoc
from pathlib import Path
from typing import Any

import pytest

import flowsculpt
from flowsculpt import api
from flowsculpt.pipeline import mesh


@pytest.mark.parametrize("name", flowsculpt.__all__)
def test_each_public_name_is_there_with_a_docstring_of_its_own(name: str) -> None:
    """Enough for `help`, and for the API page of the site, which is made of these docstrings."""
    public = getattr(flowsculpt, name)
    assert public.__name__ == name and vars(public).get("__doc__", public.__doc__)
    assert len(getdoc(public) or "") >= 40


@pytest.mark.parametrize("module", [flowsculpt, mesh, api], ids=lambda module: module.__name__)
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
