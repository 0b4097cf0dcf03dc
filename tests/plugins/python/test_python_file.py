"""Flows in Python files: only with permission, and what goes wrong is told."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.errors import FrameError, UsageError
from flowsculpt.pipeline.flow import Sequence, checked_displacement
from flowsculpt.pipeline.flow.flow import foreign_flows
from flowsculpt.pipeline.plugins.python.python_flow import PythonFlow
from flowsculpt.render.base.input_files import InputFile

POINTS = np.random.default_rng(0).normal(size=(5, 3))


def flow_of(file: Path, code: str, function: str = "f", allowed: bool = True) -> PythonFlow:
    file.write_text(code)
    return PythonFlow(function, InputFile(file).digest(), file, allowed)


def test_a_function_of_a_file_moves_points(tmp_path: Path) -> None:
    code = "import numpy as np\n\ndef f(points, time, dt):\n    return points + dt * np.array([0, time, 1])\n"
    moved = checked_displacement(flow_of(tmp_path / "a.py", code), POINTS, 2.0, 0.5, 3)
    np.testing.assert_array_equal(moved, POINTS + np.array([0.0, 1.0, 0.5]))


def test_a_function_may_change_the_points_that_it_is_given(tmp_path: Path) -> None:
    flow = flow_of(tmp_path / "a.py", "def f(points, time, dt):\n    points += 1\n    return points\n")
    given = POINTS.copy()
    moved = flow.displace(given, 0.0, 0.1)
    np.testing.assert_array_equal(given, POINTS)
    np.testing.assert_array_equal(moved, POINTS + 1)


DATACLASS = """\
from __future__ import annotations
from dataclasses import dataclass

runs = []

@dataclass
class Lift:
    speed: float = 2.0

def f(points, time, dt):
    runs.append(1)
    return points + Lift().speed * dt

def g(points, time, dt):
    return points + len(runs)
"""


def test_the_file_is_a_module_that_its_dataclasses_find(tmp_path: Path) -> None:
    flow = flow_of(tmp_path / "a.py", DATACLASS)
    np.testing.assert_array_equal(flow.displace(POINTS, 0.0, 0.5), POINTS + 1)
    assert vars(sys.modules[f"flowsculpt_flow_{flow.digest}"])["__file__"] == str(flow.path)
    other = PythonFlow("g", flow.digest, flow.path, True)
    np.testing.assert_array_equal(other.displace(POINTS, 0.0, 0.5), POINTS + 1)


def test_a_file_that_fails_leaves_no_module(tmp_path: Path) -> None:
    flow = flow_of(tmp_path / "a.py", "raise SystemExit('no')\n")
    with pytest.raises(FrameError, match="running it raised SystemExit: no"):
        flow.displace(POINTS, 0.0, 0.1)
    assert f"flowsculpt_flow_{flow.digest}" not in sys.modules


def test_nothing_of_the_file_runs_without_permission(tmp_path: Path) -> None:
    trap = tmp_path / "ran"
    code = f"open({str(trap)!r}, 'w')\ndef f(points, time, dt):\n    return points\n"
    flow = flow_of(tmp_path / "a.py", code, allowed=False)
    with pytest.raises(UsageError, match=r"a\.py: the shot would run this Python file.*add --allow-code"):
        next(foreign_flows(Sequence((flow,)))).require_permission()
    with pytest.raises(UsageError, match="needs permission"):
        flow.displace(POINTS, 0.0, 0.1)
    flow.cache_data(0.0, 0.1)
    assert not trap.exists()
    assert list(foreign_flows(Sequence((flow, Sequence((flow,)))))) == [flow, flow]


WRONG = {
    "raises": (
        "def f(p, t, dt):\n    x = 1\n    return x / 0\n",
        r"ZeroDivisionError: division by zero \(line 3\)",
    ),
    "exits": ("def f(p, t, dt):\n    raise SystemExit(3)\n", r"SystemExit: 3 \(line 2\)"),
    "shape": (
        "def f(p, t, dt):\n    return p[:2]\n",
        r"returned an array of shape \(2, 3\) for points of shape \(5, 3\)",
    ),
    "nothing": (
        "def f(p, t, dt):\n    pass\n",
        r"returned an array of shape \(\) for points of shape \(5, 3\)",
    ),
    "infinite": (
        "def f(p, t, dt):\n    return p + float('inf')\n",
        "moved vertex 0 from .*points must stay finite",
    ),
    "other name": ("def g(p, t, dt):\n    return p\n", "it does not define function f"),
    "no Python": ("def f(p, t, dt)\n", r"SyntaxError: expected ':' .*\(line 1\)"),
    "import": ("import nowhere_to_be_found\n", r"ModuleNotFoundError: .*\(line 1\)"),
    "arguments": ("def f(p):\n    return p\n", "TypeError: .*takes points"),
}


@pytest.mark.parametrize(("code", "says"), WRONG.values(), ids=WRONG)
def test_what_goes_wrong_is_told_in_one_line(code: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(FrameError, match=says) as told:
        checked_displacement(flow_of(tmp_path / "a.py", code), POINTS, 0.0, 0.1, 7)
    assert str(told.value).startswith("frame 7: ") and "\n" not in str(told.value)


def test_a_file_that_was_changed_since_is_not_run(tmp_path: Path) -> None:
    flow = flow_of(tmp_path / "a.py", "def f(p, t, dt):\n    return p\n")
    (tmp_path / "a.py").write_text("def f(p, t, dt):\n    return 2 * p\n")
    with pytest.raises(FrameError, match="was changed since the work was planned"):
        checked_displacement(flow, POINTS, 0.0, 0.1, 1)


def test_its_source_decides_what_acts(tmp_path: Path) -> None:
    one = flow_of(tmp_path / "a.py", "def f(p, t, dt):\n    return p\n")
    same = flow_of(tmp_path / "b.py", "def f(p, t, dt):\n    return p\n")
    other = flow_of(tmp_path / "c.py", "def f(p, t, dt):\n    return 2 * p\n")
    assert one.cache_data(0.0, 0.1) == same.cache_data(0.0, 0.1) != other.cache_data(0.0, 0.1)


READS = "import numpy as np\n\ndef f(points, time, dt):\n    return points + np.load({!r})\n"


def test_a_file_that_the_shot_does_not_name_is_not_opened(tmp_path: Path) -> None:
    np.save(tmp_path / "shift.npy", np.ones(3))
    code = READS.format(str(tmp_path / "shift.npy"))
    flow = flow_of(tmp_path / "a.py", code)
    with pytest.raises(
        FrameError, match=r"a\.py: it opens .*shift\.npy, .* Write reads: \[shift\.npy\], with its"
    ):
        flow.displace(POINTS, 0.0, 0.1)
    named = replace(flow, files=(tmp_path / "shift.npy",), reads=("digest",))
    np.testing.assert_array_equal(named.displace(POINTS, 0.0, 0.1), POINTS + 1)
    assert np.load(tmp_path / "shift.npy").sum() == 3.0, "other code reads what it likes"
    assert named.cache_data(0.0, 0.1) != flow.cache_data(0.0, 0.1)
    assert "reads" not in flow.cache_data(0.0, 0.1), "keys of flows that open nothing stay"
