"""Each stage makes what it made when its version was recorded; keys rely on it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterator
from importlib.metadata import version as true_version
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flowsculpt.pipeline.production import stages
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.request import shot_source
from flowsculpt.pipeline.production.stages import STAGES
from tests.production.stage_results import (
    EVERY_STAGE,
    NAME,
    QUALITY,
    RECORD,
    SCALE,
    Arrays,
    environment,
    results,
)

ANEW = "python -m tests.production.stage_results records them anew"


@pytest.fixture(scope="module")
def recorded() -> tuple[dict[str, Any], dict[str, Arrays]]:
    arrays = dict(np.load(RECORD))
    about = json.loads(str(arrays.pop("about")))
    by_stage: dict[str, Arrays] = defaultdict(dict)
    for name, array in arrays.items():
        stage, _, rest = name.partition("/")
        by_stage[stage][rest] = array
    return about, by_stage


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, dict[str, Arrays]]]:
    """The working folder in which all stages did their work, and what they made."""
    root = tmp_path_factory.mktemp("reference")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(root)
        yield root, results(root)


@pytest.fixture(scope="module")
def moved(
    recorded: tuple[dict[str, Any], dict[str, Arrays]], made: tuple[Path, dict[str, Arrays]]
) -> list[str]:
    """The stages whose results differ from those recorded, in their order."""
    about, before = recorded
    exact = environment().items() <= about.items()
    return [stage for stage, arrays in made[1].items() if not agree(arrays, before[stage], exact)]


def agree(now: Arrays, before: Arrays, exact: bool) -> bool:
    """True if arrays are equal bit for bit or, where not `exact`, of about the same size, mean and spread."""
    if now.keys() != before.keys():
        return False
    if exact:
        return all(np.array_equal(now[name], before[name], equal_nan=True) for name in before)
    return all(is_near(now[name], before[name]) for name in before)


def is_near(now: np.ndarray, before: np.ndarray) -> bool:
    """True if size and mean agree within 5%, and the spread, which holds the noise of samples, within 25%."""
    slack = 0.02 * np.nanmax(np.abs(before))
    return (
        abs(now.size - before.size) <= 0.05 * before.size
        and abs(np.nanmean(now) - np.nanmean(before)) <= 0.05 * abs(np.nanmean(before)) + slack
        and abs(np.nanstd(now) - np.nanstd(before)) <= 0.25 * np.nanstd(before) + slack
    )


@pytest.mark.parametrize("stage", EVERY_STAGE, ids=lambda stage: stage.name)
def test_results_of_a_stage_move_only_with_its_version(
    stage: Any, recorded: tuple[dict[str, Any], dict[str, Arrays]], moved: list[str]
) -> None:
    known = recorded[0]["stages"].get(stage.name)
    assert known == stage.version, f"{stage.name}: version {stage.version}, recorded at {known}; {ANEW}"
    if stage.name not in moved:
        return
    if stage.name != moved[0]:
        pytest.skip(f"it comes after {moved[0]}, whose results moved")
    pytest.fail(
        f"results of stage {stage.name} moved while its version did not: raise it in "
        f"pipeline/production/stages.py, then {ANEW}"
    )


def test_another_machine_may_differ_in_last_bits_but_not_in_what_is_seen() -> None:
    picture = np.linspace(0.0, 1.0, 600).reshape(10, 20, 3)
    assert agree({"a": picture + 1e-7}, {"a": picture}, exact=False)
    assert not agree({"a": picture + 1e-7}, {"a": picture}, exact=True)
    assert not agree({"a": picture * 1.2}, {"a": picture}, exact=False)


FOLLOWING = {
    "simulate": ["smooth_normals", "frame_camera", "render", "finish", "assemble", "film"],
    "smooth_normals": ["render", "finish", "assemble", "film"],
    "render": ["finish", "assemble", "film"],
    "finish": ["assemble", "film"],
    "assemble": [],
    "film": [],
    "png": [],
}


@pytest.mark.parametrize("name", FOLLOWING)
def test_a_raised_version_makes_the_stage_and_what_follows_again(
    name: str, made: tuple[Path, dict[str, Arrays]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shot_source, "_code", lambda: [f"with another {name}"])
    monkeypatch.setitem(
        vars(STAGES[name]), "recipe", {**STAGES[name].recipe, "version": STAGES[name].version + 1}
    )
    assert tasks_of_film(made[0]) == {*([name] if name != "png" else []), *FOLLOWING[name]}


def test_a_package_that_decides_results_counts_and_others_do_not(
    made: tuple[Path, dict[str, Arrays]], monkeypatch: pytest.MonkeyPatch
) -> None:
    versions = {"pydantic": "999", "snakemake": "999"}
    monkeypatch.setattr(stages, "version", lambda name: versions.get(name) or true_version(name))
    for run in ("others", "pyoidn"):
        versions[run] = "999"
        monkeypatch.setattr(shot_source, "_code", lambda run=run: [run])
        for stage in STAGES.values():
            monkeypatch.delitem(vars(stage), "recipe", raising=False)
        assert tasks_of_film(made[0]) == (set() if run == "others" else {"finish", "assemble", "film"})


def test_an_edit_of_our_sources_that_changes_no_result_makes_nothing_again(
    made: tuple[Path, dict[str, Arrays]], tmp_path: Path
) -> None:
    project = Path(stages.__file__).parents[2]
    for folder in ("pipeline", "render", "profiles"):
        shutil.copytree(project / folder, tmp_path / folder, ignore=shutil.ignore_patterns("__pycache__"))
    sources = sorted(tmp_path.rglob("*.py"))
    for source in sources:
        with source.open("a", encoding="utf-8") as file:
            file.write("# another comment\n")
    command = [sys.executable, "-m", "flowsculpt", "--dry-run", "render", NAME, "--scale", SCALE]
    done = subprocess.run(
        command, cwd=made[0], env={**os.environ, "PYTHONPATH": str(tmp_path)}, capture_output=True, text=True
    )
    assert len(sources) > 300
    assert "Nothing to be done" in done.stdout, done.stdout + done.stderr


def tasks_of_film(root: Path) -> set[str]:
    """The stages that have work to do before the film is there."""
    return {job.stage for job in Project(root, 1).film(QUALITY).jobs}
