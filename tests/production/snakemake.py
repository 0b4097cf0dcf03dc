"""Snakemake for tests: the real command, and a stand-in for its `workflow` object."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

CHECKOUT = Path(__file__).parents[2]


def snakemake(folder: Path, *words: str, cores: int | None = 2) -> subprocess.CompletedProcess[str]:
    """Run `snakemake` in a folder, with the Snakefile and the settings of the checkout.

    cores  of this machine; None where a profile runs jobs elsewhere
    """
    command = [sys.executable, "-m", "snakemake", "--snakefile", str(CHECKOUT / "Snakefile")]
    command += ["--workflow-profile", str(CHECKOUT / "profiles" / "default")]
    command += [*(() if cores is None else ("--cores", str(cores))), *words]
    return subprocess.run(
        command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=300
    )


def workflow(*targets: str, nodes: int | None = None, **settings: Any) -> Any:
    """Return what the Snakefile sees of Snakemake when it runs nothing: on this machine, or on a farm."""
    known = {"targets": set(targets), "forcerun": set(), "forceall": False, "forcetargets": False}
    return SimpleNamespace(
        is_main_process=True,
        local_exec=nodes is None,
        nodes=nodes,
        _cores=2,
        dag_settings=SimpleNamespace(**{**known, **settings}),
        executor_plugin=None,
        dryrun=False,
    )
