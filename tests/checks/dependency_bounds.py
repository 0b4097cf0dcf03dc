"""Run the tests with the lowest or the newest versions of what pyproject.toml asks for, in a new environment.

    python tests/checks/dependency_bounds.py lowest-direct|highest [WORDS OF PYTEST…]

Lower bounds are true only if something runs there; and a new release breaks what the lock does not show.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
EXTRAS = ("film", "alembic", "cluster", "fields", "gain-maps", "models", "s3", "usd")
"""Those that tests use. Snakemake's plug-in for SLURM asks for a later numpy than the rest."""

TESTS = ("-q", "-m", "not soak", "-n", "2", "--dist", "loadfile", "--no-loadscope-reorder")


def run(*words: str | Path) -> None:
    """Run a command in the root. Raises CalledProcessError where it fails."""
    print("$", *words, flush=True)
    subprocess.run([*map(str, words)], cwd=ROOT, check=True)


def environment(resolution: str) -> Path:
    """Make the environment of a resolution, as uv calls it; return its Python."""
    home = ROOT / ".venv" / "bounds"
    uv, folder, versions = home / "uv" / "bin" / "uv", home / resolution, home / f"{resolution}.txt"
    if not uv.is_file():
        run(sys.executable, "-m", "pip", "install", "--quiet", "--target", home / "uv", "uv")
    shutil.rmtree(folder, ignore_errors=True)
    python = folder / "bin" / "python"
    run(uv, "venv", "--quiet", "--python", sys.executable, folder)
    run(
        *(uv, "pip", "compile", "--quiet", "--python", python, "--resolution", resolution),
        *(word for extra in EXTRAS for word in ("--extra", extra)),
        *("pyproject.toml", "-o", versions),
    )
    run(
        *(uv, "pip", "install", "--quiet", "--python", python),
        *("-r", versions, "-c", versions, "--group", "dev", "--group", "build", "pip", "-e", "."),
    )
    return python


if __name__ == "__main__":
    python = environment(sys.argv[1])
    run(python, "-m", "flowsculpt", "doctor", "--prepare")
    run(python, "-m", "pytest", *TESTS, *sys.argv[2:])
