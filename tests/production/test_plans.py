"""Plans as Snakemake sees them: few jobs, each after those that make what it reads, and in one small file."""

from __future__ import annotations

import math
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.planning.batches import (
    MAX_BATCH,
    MIN_BATCH,
    MIN_LAST_BATCH,
    FrameWork,
    batch_sizes,
    batches,
    even_batches,
)
from flowsculpt.pipeline.production.planning.plan import Plan
from flowsculpt.pipeline.production.stages import STAGES, forced_with
from flowsculpt.pipeline.production.store.event_log import EventLog
from flowsculpt.pipeline.production.store.paths import EVENTS

pytestmark = pytest.mark.quick

SHOT = (
    "title: T\nframes: 1-{frames}\nsubject: {{solid: box}}\nresample: off\n"
    "flows:\n  - twist: {{axis: y, amount: {{keys: {{1: 0, 5: 60}}}}}}\n"
)


@given(st.integers(1, 2000), st.integers(1, 64))
def test_batches_hold_every_frame_once_and_shrink_towards_the_end(count: int, cores: int) -> None:
    found = batches(range(count), cores)
    assert [number for batch in found for number in batch] == list(range(count))
    sizes = [len(batch) for batch in found]
    assert sizes == sorted(sizes, reverse=True)
    assert max(sizes) <= MAX_BATCH
    assert len(found) >= min(cores, count // max(MIN_BATCH, -(-count // cores)))


def test_long_shots_begin_with_long_batches_and_end_with_short_ones() -> None:
    sizes = [len(batch) for batch in batches(range(1000), 2)]
    assert sizes[0] == 250 and sizes[-2] == MIN_LAST_BATCH
    assert len(sizes) < 12
    assert [len(batch) for batch in batches(range(96), 2)] == [48, 48]


FINAL, DRAFT = 56.0, 0.5  # seconds of a frame on a node of four cores


def sizes(nodes: int, seconds: float, start: float = 3.0, shots: int = 3) -> set[int]:
    works = [FrameWork(56, seconds, math.ceil(start / seconds)) for _ in range(shots)]
    return set(batch_sizes(works, nodes, start))


def test_all_nodes_of_a_farm_have_a_batch_and_none_is_shorter_than_its_start() -> None:
    assert sizes(64, FINAL) == {3}, "168 frames: three on each of 56 nodes, where two on each were two rounds"
    assert sizes(256, FINAL) == {1}
    assert sizes(2, FINAL) == {28}
    assert sizes(2, FINAL, shots=1) == {28}
    assert min(sizes(256, DRAFT)) >= 6
    assert min(sizes(256, DRAFT, start=12.0)) >= 19  # 56 frames in three batches
    mixed = [FrameWork(56, FINAL), FrameWork(56, 4 * FINAL)]
    assert batch_sizes(mixed, 28, 3.0) == (12, 3), "24 batches of the same time, in one round"


@given(st.lists(st.integers(), unique=True, min_size=1), st.integers(1, 300))
def test_even_batches_hold_every_frame_once(order: list[int], size: int) -> None:
    found = even_batches(order, size)
    assert sorted(n for batch in found for n in batch) == sorted(order)
    assert max(map(len, found)) <= min(size, min(map(len, found)) + 1)
    assert {batch[0] for batch in found} == set(order[: len(found)]) or order == sorted(order)


@pytest.fixture
def plan(tmp_path: Path) -> Plan:
    (tmp_path / "a.yaml").write_text(SHOT.format(frames=300))
    return Project(tmp_path, 2, variant="scalar_rgb").pictures([str(tmp_path / "a.yaml")], "draft")


def test_a_frozen_plan_knows_what_each_job_reads(plan: Plan, tmp_path: Path) -> None:
    thawed = Plan.thaw(tmp_path / plan.freeze(tmp_path))
    by_output = {job.output: job for job in thawed.jobs}
    assert thawed.jobs == plan.jobs and len(by_output) == len(plan.jobs)
    read = {job.stage: {by_output[o].stage for o in thawed.all_inputs(job)} for job in thawed.jobs}
    assert read == {
        "simulate": set(),
        "smooth_normals": {"simulate"},
        "frame_camera": {"simulate"},
        "render": {"frame_camera", "smooth_normals"},
        "finish": {"render"},
        "assemble": {"finish"},
    }
    assert "renders/a/draft/a.mp4" in thawed.outputs


def test_a_plan_is_named_after_all_others_also_where_the_clock_was_set_back(
    plan: Plan, tmp_path: Path
) -> None:
    assert plan.named_last(tmp_path).name == plan.name
    EventLog(tmp_path / EVENTS / "20991231-235959-12.jsonl").write("run")
    second = plan.named_last(tmp_path)
    assert second.name == f"21000101-000000-{os.getpid()}"
    EventLog(tmp_path / EVENTS / f"{second.name}.jsonl").write("run")
    assert plan.named_last(tmp_path).name > second.name


def test_a_frozen_plan_does_not_grow_by_a_file_name_a_frame(plan: Plan, tmp_path: Path) -> None:
    assert (tmp_path / plan.freeze(tmp_path)).stat().st_size < 300 * 50


def test_done_files_change_with_the_shot_and_back(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"

    def outputs(text: str) -> list[str]:
        path.write_text(text)
        return [
            job.output
            for job in Project(tmp_path, 2, variant="scalar_rgb").pictures([str(path)], "draft").jobs
        ]

    shot = SHOT.format(frames=6)
    before = outputs(shot)
    assert not set(outputs(shot.replace("5: 60", "5: 61"))) & set(before) - {"renders/a/draft/a.mp4"}
    assert outputs(shot) == before


def test_forcing_a_stage_forces_all_that_read_it() -> None:
    assert forced_with(["simulate"]) == set(STAGES)
    assert forced_with(["finish"]) == {"finish", "assemble", "film", "png", "png16", "jpeg"}
    assert forced_with([]) == set()
