"""The extension in Blender as a module, which `make blender` installs: see scenarios.py."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

BLENDER = Path(os.environ.get("BLENDER_MODULE", Path(sys.prefix) / "cycles"))

pytestmark = [
    pytest.mark.soak,
    pytest.mark.skipif(not (BLENDER / "bpy").is_dir(), reason="Blender is not there: make blender"),
]

ROOT = Path(__file__).parents[2]

SHOT = """\
title: A box, twisted   # by hand
frames: 1-6
subject: {solid: box, size: [2, 2, 2]}
resample: {max_edge_length: 0.4}
flows:
  # the middle stays
  - twist: {axis: y, amount: {ease: linear, keys: {1: 0, 4: 36, 6: {value: 60, ease: sine_in_out}}}}  # wrung
  - sum:
      - vortex: {axis: [0, 0.6, 0.8], centre: [0.9, 0.3, 0], radius: 0.8, strength: 1.5}   # off the middle
      - placed: {translate: [0.5, 0, 0], rotate: [0, 90, 0], flows: [{vortex: {centre: [0, 0, 0.2]}}]}
camera: {azimuth: -30, elevation: 14}
quality: {draft: {samples: 1}}
"""


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built_package(tmp_path_factory.mktemp("dist"))


def built_package(folder: Path) -> Path:
    """Build the extension's zip into a folder and return its path."""
    command = [sys.executable, str(ROOT / "blender" / "build_extension.py"), str(folder)]
    return Path(subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip())


def in_blender(scenario: str, package: Path, folder: Path, shot: str = SHOT) -> str:
    """Run a scenario in a new show with a shot, in a Blender with settings of its own; return its result."""
    (folder / "show" / "shots").mkdir(parents=True)
    (folder / "show" / "shots" / "T010_tiny.yaml").write_text(shot)
    script, program = Path(__file__).with_name("scenarios.py"), Path(sys.executable).with_name("flowsculpt")
    command = [sys.executable, "-P", str(script), scenario, str(package), str(program), str(folder / "show")]
    environment = {**os.environ, "PYTHONPATH": str(BLENDER), "BLENDER_USER_RESOURCES": str(folder / "user")}
    ran = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=600)
    said = [line for line in ran.stdout.splitlines() if line.startswith("RESULT ")]
    assert ran.returncode == 0 and said, ran.stdout[-3000:] + ran.stderr[-3000:]
    return said[-1].removeprefix("RESULT ")


@pytest.mark.parametrize(
    "scenario",
    [
        *(
            "scrub",
            "edit",
            "edit_keys",
            "undo",
            "at_once",
            "camera",
            "render",
            "use_in_scene",
            "film",
            "subject",
            "mistakes",
        ),
        *("formula", "own_time", "kinds", "uninstall"),
    ],
)
def test_an_artist_works_with_a_shot(scenario: str, package: Path, tmp_path: Path) -> None:
    in_blender(scenario, package, tmp_path)


def test_blender_finds_the_package_valid(package: Path) -> None:
    (tool,) = (BLENDER / "bpy").glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py")
    command = [sys.executable, "-P", str(tool), "validate", str(package)]  # what `extension validate` runs
    ran = subprocess.run(command, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stdout + ran.stderr
