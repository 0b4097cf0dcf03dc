"""Imports of the command before it knows what is requested."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from pipeline.cli.app import name_a_home
from tests.conftest import QUALITY

HEAVY = ("numba", "numpy", "OpenImageIO", "mitsuba", "drjit", "av", "imageio", "snakemake", "matplotlib")

SCRIPT = """
import sys
from pipeline.cli.app import main
sys.argv = ["flowsculpt", *sys.argv[1:]]
try:
    main()
except SystemExit:
    pass
print(*sorted(sys.modules), file=sys.stderr)
"""


def modules_of(*words: str, folder: Path | None = None) -> set[str]:
    """Modules that are imported when the command has run in a folder."""
    command = [sys.executable, "-c", SCRIPT, *words]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True)
    return set(done.stderr.splitlines()[-1].split())


@pytest.mark.slow
@pytest.mark.parametrize("words", [("--version",), ("--help",), ("report", "--help"), ("clen",)])
def test_a_command_that_computes_nothing_imports_nothing_heavy(words: tuple[str, ...]) -> None:
    assert not modules_of(*words).intersection(HEAVY)


@pytest.mark.slow
def test_processes_that_read_models_import_no_numba() -> None:
    readers = ("fbx_files", "fbx_paint", "gltf_files", "gltf_paint", "usd_files", "usd_paint")
    imports = "".join(f"import pipeline.plugins.interchange.{reader}\n" for reader in readers)
    checked = f"{imports}import sys\nassert 'numba' not in sys.modules"
    subprocess.run([sys.executable, "-c", checked], check=True)


def test_what_is_up_to_date_is_found_without_anything_heavy(finished: Any) -> None:
    words = ("render", "T010_tiny", "-q", QUALITY)
    assert finished.run(*words).code == 0, "plans are remembered by the paths of shots, and this is a copy"
    assert not modules_of("--no-progress", *words, folder=finished.path).intersection(HEAVY)


def test_an_account_without_a_home_gets_one_that_holds_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    for home, named in (("/home/somebody", "/home/somebody"), ("relative", os.devnull)):
        monkeypatch.setenv("HOME", home)
        name_a_home()
        assert os.environ["HOME"] == named
