"""Timings of a run by activity, and estimates from timings measured on this machine."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from pipeline.errors import MissingInputError
from pipeline.production.maintenance.run_report import RunReport, named_run
from pipeline.production.planning.estimate import estimate
from pipeline.production.planning.plan import Job, Plan
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.request.shot_source import ShotSource

pytestmark = pytest.mark.quick

PLACE = "renders/A/draft"
SHOT = "title: A\nframes: 1-10\nsubject: {solid: box, size: [2, 2, 2]}\nresample: off\n"


def log(root: Path, name: str, *events: dict[str, object]) -> None:
    folder = root / ".flowsculpt/events"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{name}.jsonl").write_text(
        "".join(json.dumps({"job": "", **event}) + "\n" for event in events)
    )


def frame(time: float, job: str, number: int, seconds: float, found: bool = False) -> dict[str, object]:
    facts = {
        "stage": job,
        "shot": "A",
        "frame": number,
        "seconds": seconds,
        "found": found,
        "quality": "draft",
    }
    return {"time": time, "event": "frame", "job": job, **facts}


def statistics(
    root: Path, number: int, light: float, rest: float, place: str = PLACE, threads: int = 1
) -> None:
    folder = root / place / "statistics"
    folder.mkdir(parents=True, exist_ok=True)
    seconds = {"rendering": light, "building": rest}
    told = {"key": "k", "seconds": seconds, "threads": threads, "peak_memory_mib": 500}
    (folder / f"A.{number:04d}.json").write_text(json.dumps(told))


def a_run(root: Path) -> RunReport:
    statistics(root, 1, 3.0, 1.0)
    log(
        root,
        "run",
        {"time": 0.0, "event": "run", "cores": 2},
        {"time": 1.0, "event": "begin", "job": "simulate", "threads": 1},
        frame(3.0, "simulate", 1, 1.5),
        {"time": 3.0, "event": "end", "job": "simulate"},
        {"time": 3.0, "event": "begin", "job": "render", "threads": 2},
        frame(7.5, "render", 1, 4.0),
        frame(7.5, "render", 2, 0.0, found=True),
        {"time": 8.0, "event": "end", "job": "render"},
        {"time": 10.0, "event": "ran"},
    )
    return RunReport.of(root, "run", cores=64)


def test_every_second_of_every_core_is_accounted_for(tmp_path: Path) -> None:
    spending = a_run(tmp_path)
    assert (spending.seconds, spending.cores) == (10.0, 2)
    assert spending.core_seconds == pytest.approx(
        {"simulate": 1.5, "rendering": 6.0, "building": 2.0, "render": 0.0, "starting": 2.5, "waiting": 8.0}
    )
    assert sum(spending.shares.values()) == pytest.approx(1.0)
    assert spending.frames == {"simulate": 1, "render": 1}


def test_one_line_names_the_largest_parts_first(tmp_path: Path) -> None:
    said = a_run(tmp_path).in_brief()
    assert said.startswith("planning, Snakemake, waiting 40%, rendering: light and auxiliary AOVs 30%")


def test_a_job_that_was_killed_held_its_core_to_the_end(tmp_path: Path) -> None:
    log(
        tmp_path,
        "run",
        {"time": 0.0, "event": "run", "cores": 1},
        {"time": 1.0, "event": "begin", "job": "render", "threads": 1},
        {"time": 5.0, "event": "ran"},
    )
    assert RunReport.of(tmp_path, "run", cores=1).core_seconds == {"starting": 4.0, "waiting": 1.0}


def test_a_run_that_left_no_log_is_told_with_those_that_did(tmp_path: Path) -> None:
    with pytest.raises(MissingInputError, match="no run has left a log"):
        named_run(tmp_path, None)
    log(tmp_path, "20260101-1")
    log(tmp_path, "20260102-2")
    assert named_run(tmp_path, None) == "20260102-2"
    with pytest.raises(MissingInputError, match="'x'; the last ones are 20260101-1, 20260102-2"):
        named_run(tmp_path, "x")


def plan_of(*jobs: Job, quality: str = "draft", settings: tuple[str, ...] = ()) -> Plan:
    request = RenderRequest(ShotSource(SHOT, Path("/shots/A.yaml"), settings), quality, "none", ())
    return Plan((request,), None, jobs)


def test_frames_of_the_same_kind_tell_what_frames_will_take(tmp_path: Path) -> None:
    a_run(tmp_path)
    statistics(tmp_path, 2, 5.0, 1.0, threads=2)
    jobs = (
        Job("s", "simulate", (0,), tuple(range(10))),
        Job("r", "render", (0,), tuple(range(10))),
    )
    expected = estimate(plan_of(*jobs), tmp_path, cores=2)
    assert expected.core_seconds == pytest.approx({"simulate": 15.0, "render": 10 * (4.0 + 12.0) / 2})
    assert expected.seconds == pytest.approx(15.0 + 40.0)
    assert expected.by == "2 frames of A at draft"
    assert expected.unmeasured == ()


def test_another_quality_goes_by_samples_and_pixels(tmp_path: Path) -> None:
    statistics(tmp_path, 1, 2.0, 1.0)
    expected = estimate(plan_of(Job("r", "render", (0,), (1,)), quality="final"), tmp_path, cores=1)
    assert expected.seconds == pytest.approx((2.0 * 40 / 4 + 1.0) * (1920 * 1080) / (480 * 270))


def test_larger_pictures_of_the_same_quality_take_longer(tmp_path: Path) -> None:
    statistics(tmp_path, 1, 2.0, 1.0)
    plan = plan_of(Job("r", "render", (0,), (1,)), settings=("picture.size=[3840, 2160]",))
    assert estimate(plan, tmp_path, cores=1).seconds == pytest.approx(3.0 * 4)
    file = tmp_path / PLACE / "statistics" / "A.0001.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), "pixels": 960 * 540}))
    assert estimate(plan, tmp_path, cores=1).seconds == pytest.approx(3.0)


def test_what_was_never_done_here_is_said_to_be_unknown(tmp_path: Path) -> None:
    expected = estimate(plan_of(Job("r", "render", (0,), (1, 2))), tmp_path, cores=2)
    assert expected.unmeasured == ("render",)
    assert expected.core_seconds == {}
    assert expected.bytes is None and expected.fits


def test_files_that_are_there_tell_how_large_others_become(tmp_path: Path) -> None:
    for kind, size in (("raw", 4000), ("frames", 1000)):
        folder = tmp_path / PLACE / kind
        folder.mkdir(parents=True)
        (folder / "A.0001.exr").write_bytes(b"x" * size)
    jobs = (Job("r", "render", (0,), (2, 3)), Job("f", "finish", (0,), (2, 3)))
    assert estimate(plan_of(*jobs), tmp_path, cores=2).bytes == 2 * 5000
