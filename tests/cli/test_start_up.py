"""Imports of the command before it knows what is requested."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from flowsculpt.pipeline.cli.app import name_a_home
from tests.conftest import QUALITY

HEAVY = ("numba", "numpy", "OpenImageIO", "mitsuba", "drjit", "av", "imageio", "snakemake", "matplotlib")

SCRIPT = """
import sys
from flowsculpt.pipeline.cli.app import main
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
@pytest.mark.parametrize("words", [("--version",), ("--help",), ("stills", "--help"), ("clen",)])
def test_a_command_that_computes_nothing_imports_nothing_heavy(words: tuple[str, ...]) -> None:
    assert not modules_of(*words).intersection(HEAVY)


def test_what_is_up_to_date_is_found_without_anything_heavy(finished: Any) -> None:
    words = ("render", "T010_tiny", "-q", QUALITY)
    assert finished.run(*words).code == 0, "plans are remembered by the paths of shots, and this is a copy"
    assert not modules_of("--no-progress", *words, folder=finished.path).intersection(HEAVY)


def test_an_account_without_a_home_gets_one_that_holds_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    for home, named in (("/home/somebody", "/home/somebody"), ("relative", os.devnull)):
        monkeypatch.setenv("HOME", home)
        name_a_home()
        assert os.environ["HOME"] == named


OURS = "from flowsculpt.__main__ import main; import sys; sys.argv = ['flowsculpt', *sys.argv[1:]]; main()"
OWN = "from flowsculpt.render.base.python_process import prepare; prepare(); "
ROOT = Path(__file__).parents[2]


def test_packages_that_another_program_names_in_pythonpath_are_passed_over(tmp_path: Path) -> None:
    for name in ("numpy", "pydantic", "rich", "ruamel", "typer", "yaml"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise ImportError('of another Python')")
    code = f"{OWN}import sys, numpy, pydantic, rich, typer, yaml; print(sys.path[-1])"
    paths = {**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{tmp_path}"}
    done = subprocess.run([sys.executable, "-c", code], env=paths, capture_output=True, text=True)
    assert (done.stdout, done.stderr) == (f"{tmp_path}\n", ""), "plug-ins there are found"


@pytest.mark.slow
def test_ctrl_c_while_the_command_starts_says_nothing_and_exits_with_130(tmp_path: Path) -> None:
    for module in (
        "signal",
        "pathlib",
        "importlib.metadata",
        "flowsculpt.render",
        "rich.console",
        "typer.main",
    ):
        words = [sys.executable, "-X", "importtime", "-c", OURS, "doctor"]
        with subprocess.Popen(words, cwd=ROOT, stderr=subprocess.PIPE, text=True) as process:
            assert process.stderr is not None
            for line in process.stderr:  # until it has imported so much
                if line.rpartition("|")[2].strip() == module:
                    break
            process.send_signal(signal.SIGINT)
            told = process.stderr.read()
        assert process.returncode == 130 and "Traceback" not in told, (module, told[-2000:])


@pytest.mark.slow
@pytest.mark.parametrize(
    "settings",
    [
        {"NUM_THREADS": "0", "OPT": "9", "DEBUG": "x", "THREADING_LAYER_PRIORITY": "x"},
        {"NUM_THREADS": "abc"},
    ],
)
def test_settings_of_numba_that_it_cannot_read_are_passed_over(settings: dict[str, str]) -> None:
    code = f"{OWN}import flowsculpt.pipeline.resample.resampler, numba; numba.set_num_threads(1)"
    variables = {**os.environ, **{f"NUMBA_{name}": value for name, value in settings.items()}}
    done = subprocess.run(
        [sys.executable, "-c", code], env=variables, capture_output=True, text=True, cwd=ROOT
    )
    assert (done.returncode, done.stderr) == (0, "")
