"""What the Snakefile runs: a plan that was frozen before, or one made here for who calls Snakemake directly.

Snakemake reads the Snakefile before its first job starts, so what only planning needs is imported only where
a plan is made.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from filelock import BaseFileLock

from pipeline.errors import UsageError
from pipeline.production.planning.plan import Plan
from pipeline.production.store.paths import LOGS, PLANS

_LATEST = PLANS / "latest"

_HELD: list[BaseFileLock] = []
"""The locks this process holds until it ends."""


def plan_of(config: Mapping[str, Any], cores: int, main: bool) -> tuple[Plan, str, str]:
    """The plan a Snakefile runs, its frozen file, and the folder for what its jobs print.

    `config["plan"]` names one; without it the main process makes one of `config`'s shot, frames and
    quality, or of its edit (by default the film at draft), and holds the root's lock, and the processes of
    its jobs take the latest.
    """
    root = Path.cwd()
    if "plan" in config:
        path = Path(str(config["plan"]))
    elif main:
        path = _planned(root, config, cores)
    else:
        path = Path((root / _LATEST).read_text())
    plan = Plan.thaw(root / path)
    return plan, path.as_posix(), (LOGS / plan.name).as_posix()


def _planned(root: Path, config: Mapping[str, Any], cores: int) -> Path:
    """The frozen file of a plan for what `config` asks for."""
    from pipeline.production.execution.project import Project
    from pipeline.production.execution.run import acquire
    from pipeline.production.request.lookup import FILM, find_edit

    quality = str(config.get("quality", "draft"))
    project = Project(root, cores, allow_code=_allowed(config.get("allow_code", False)))
    frames = str(config["frames"]) if "frames" in config else None
    plan = (
        project.pictures([str(config["shot"])], quality, frames)
        if "shot" in config
        else project.film(quality, find_edit(str(config.get("edit", FILM.stem))))
    )
    _HELD.append(acquire(root))
    plan.restore_links(project.store)
    path = plan.freeze(root)
    (root / _LATEST).write_text(path.as_posix())
    return path


def _allowed(value: Any) -> bool:
    """`--config allow_code=true`. Raises UsageError for what is neither true nor false."""
    said = str(value).lower()
    if said not in ("true", "false"):
        raise UsageError(
            f"allow_code is {value!r}; it says whether shots may run their Python files. Write true or false."
        )
    return said == "true"
