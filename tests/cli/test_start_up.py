"""How little the command imports before it knows what is asked for."""

from __future__ import annotations

import subprocess
import sys

import pytest

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


def modules_of(*words: str) -> set[str]:
    """Modules that are imported when the command has run."""
    done = subprocess.run([sys.executable, "-c", SCRIPT, *words], capture_output=True, text=True, check=True)
    return set(done.stderr.splitlines()[-1].split())


@pytest.mark.parametrize("words", [("--version",), ("--help",), ("report", "--help"), ("clen",)])
def test_a_command_that_computes_nothing_imports_nothing_heavy(words: tuple[str, ...]) -> None:
    assert not modules_of(*words).intersection(HEAVY)
