"""A GPU is used where it is asked for and can; else one line says so, and a shot is of one variant alone."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from flowsculpt.pipeline.errors import MachineError, UsageError
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.planning import profile
from flowsculpt.pipeline.production.planning.profile import avoid, require_variant, variant_for
from flowsculpt.pipeline.production.store.event_log import EventReader
from flowsculpt.pipeline.production.store.paths import EVENTS
from flowsculpt.pipeline.production.tasks import render, worker
from flowsculpt.render.mitsuba.engine import DEFAULT_ORDER, Engine

pytestmark = pytest.mark.quick

NAME = "T010_tiny"
ON_GPU = "cuda_ad_rgb"


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, int]]:
    """A machine whose GPU works or not (`gpu`), with the number of checks of that (`asked`)."""
    state = {"gpu": 0, "asked": 0}
    choose = profile.choose

    def works(variant: str) -> bool:
        state["asked"] += 1
        return variant == ON_GPU and bool(state["gpu"])

    def chosen(names: Any) -> Engine:
        return Engine(ON_GPU) if names and ON_GPU in names else choose(names)

    profile._gpu_works.cache_clear()
    monkeypatch.setattr(profile, "works", works)
    monkeypatch.setattr(profile, "choose", chosen)
    yield state
    profile._gpu_works.cache_clear()


def test_where_there_is_no_gpu_another_variant_serves_and_one_line_says_so(
    tmp_path: Path, machine: dict[str, int]
) -> None:
    told: list[str] = []
    chosen = variant_for(tmp_path, NAME, ON_GPU, told.append)
    assert chosen in DEFAULT_ORDER
    assert told == [
        "cuda_ad_rgb cannot render here: Mitsuba finds no NVIDIA GPU with a driver that it can use; "
        f"{NAME} is rendered with {chosen} instead"
    ]
    assert variant_for(tmp_path, NAME, None, lambda line: pytest.fail(line)) == chosen


def test_a_gpu_of_apples_is_missed_by_its_own_name(tmp_path: Path, machine: dict[str, int]) -> None:
    told: list[str] = []
    assert variant_for(tmp_path, NAME, "metal_ad_rgb", told.append) in DEFAULT_ORDER
    assert told[0].startswith("metal_ad_rgb cannot render here: Mitsuba finds no Apple GPU")


def test_a_gpu_that_crashed_on_a_shot_is_left_alone_for_it(tmp_path: Path, machine: dict[str, int]) -> None:
    machine["gpu"] = 1
    told: list[str] = []
    assert variant_for(tmp_path, NAME, ON_GPU, told.append) == ON_GPU and not told
    assert avoid(tmp_path, NAME, ON_GPU, f"cuda_ad_rgb crashed (SIGABRT) while rendering {NAME}")
    chosen = variant_for(tmp_path, NAME, ON_GPU, told.append)
    assert told == [
        f"cuda_ad_rgb crashed (SIGABRT) while rendering {NAME}; {NAME} is rendered with {chosen} instead"
    ]
    assert variant_for(tmp_path, "another", ON_GPU, told.append) == ON_GPU


def test_another_variant_that_crashed_is_not_replaced_behind_the_users_back(tmp_path: Path) -> None:
    avoid(tmp_path, NAME, "scalar_rgb", "scalar_rgb crashed")
    with pytest.raises(MachineError, match="scalar_rgb crashed; leave out --variant"):
        variant_for(tmp_path, NAME, "scalar_rgb")


def test_a_variant_of_nodes_is_not_tried_on_the_machine_that_plans(
    tmp_path: Path, machine: dict[str, int]
) -> None:
    assert variant_for(tmp_path, NAME, ON_GPU, lambda line: pytest.fail(line), on_nodes=True) == ON_GPU
    assert machine["asked"] == 0
    with pytest.raises(UsageError, match="Did you mean 'cuda_ad_rgb'"):
        variant_for(tmp_path, NAME, "cuda_rgb", on_nodes=True)
    avoid(tmp_path, NAME, ON_GPU, f"cuda_ad_rgb crashed (SIGABRT) while rendering {NAME}")
    assert variant_for(tmp_path, NAME, ON_GPU, lambda line: None, on_nodes=True) in DEFAULT_ORDER


def test_a_node_that_lacks_the_variant_says_its_name_what_it_lacks_and_what_to_do(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuses(names: Any) -> Engine:
        raise MachineError("none works")

    monkeypatch.setattr(profile, "choose", refuses)
    monkeypatch.setattr("platform.node", lambda: "node7")
    with pytest.raises(MachineError) as raised:
        require_variant(ON_GPU)
    told = str(raised.value)
    assert told.startswith("node7 cannot render with cuda_ad_rgb, the variant of this plan: Mitsuba finds no")
    assert "Keep its jobs off this node, or name another variant by --variant" in told


def test_a_plan_tells_it_once(project: Any, machine: dict[str, int], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(project.path)
    asked = Project(project.path, 1, ON_GPU)
    plans = [asked.pictures([NAME, NAME], "draft") for _ in range(2)]
    assert [len(plan.notes) for plan in plans] == [1, 1]
    assert machine["asked"] == 1
    assert {request.variant for plan in plans for request in plan.requests} <= set(DEFAULT_ORDER)


def test_a_gpu_that_fails_at_a_frame_is_given_up_for_the_shot(
    project: Any, machine: dict[str, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(context: Any) -> bool:
        raise RuntimeError("out of memory\nat some place in some library")

    machine["gpu"] = 1
    monkeypatch.chdir(project.path)
    monkeypatch.setattr(render, "render", fails)
    monkeypatch.setattr(worker, "_limit_kernels", lambda threads: None)
    plan = Project(project.path, 1, ON_GPU).pictures([NAME], "draft")
    (job,) = [job for job in plan.jobs if job.stage == "render"]
    assert worker.do_job(plan.freeze(project.path).as_posix(), job.name, after=0) == 1
    events = list(EventReader(project.path / EVENTS / f"{plan.name}.jsonl").new())
    assert [event["event"] for event in events] == ["begin", "healed"]
    assert "cuda_ad_rgb failed (out of memory) while rendering T010_tiny" in events[1]["message"]
    assert variant_for(project.path, NAME, ON_GPU, lambda line: None) in DEFAULT_ORDER
