"""Timings of a run by activity, and estimates from timings measured on this machine."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from flowsculpt.pipeline.errors import MissingInputError
from flowsculpt.pipeline.plugins.maintenance.run_report import RunReport, named_run
from flowsculpt.pipeline.production.planning.estimate import estimate
from flowsculpt.pipeline.production.planning.plan import Job, Plan
from flowsculpt.pipeline.production.planning.timings import MeasuredResources
from flowsculpt.pipeline.production.request.render_request import RenderRequest
from flowsculpt.pipeline.production.request.shot_source import ShotSource

pytestmark = pytest.mark.quick

PLACE = "renders/A/draft"
SHOT = "title: A\nframes: 1-10\nsubject: {solid: box, size: [2, 2, 2]}\nresample: off\n"


def log(root: Path, name: str, *events: dict[str, object]) -> None:
    folder = root / ".flowsculpt/events"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{name}.jsonl").write_text(
        "".join(json.dumps({"job": "", **event}) + "\n" for event in events)
    )


def frame(
    time: float, job: str, number: int, seconds: float, found: bool = False, cpu: float | None = None
) -> dict[str, object]:
    facts = {
        "stage": job,
        "shot": "A",
        "frame": number,
        "seconds": seconds,
        "found": found,
        "quality": "draft",
    }
    counted = {} if cpu is None else {"cpu": cpu}
    return {"time": time, "event": "frame", "job": job, **facts, **counted}


def statistics(
    root: Path, number: int, light: float, rest: float, threads: int = 1, cpu: float | None = None
) -> None:
    """Write statistics as earlier versions did or, with the CPU seconds of each second, as this one does."""
    folder = root / PLACE / "statistics"
    folder.mkdir(parents=True, exist_ok=True)
    seconds = {"rendering": light, "building": rest}
    told = {"key": "k", "seconds": seconds, "threads": threads, "peak_memory_mib": 500}
    counted = {} if cpu is None else {"cpu_seconds": {"rendering": cpu * light, "building": cpu * rest}}
    (folder / f"A.{number:04d}.json").write_text(json.dumps({**told, **counted}))


def an_old_run(root: Path) -> RunReport:
    """Report a run that was logged before CPU seconds were counted."""
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


def a_run(root: Path, load: float = 1.0, farm: bool = False) -> RunReport:
    """Report a run in which everything took `load` times the time that it takes on an idle machine."""

    def at(time: float, event: str, job: str = "", **facts: object) -> dict[str, object]:
        return {"time": load * time, "event": event, "job": job, "stage": job, **facts}

    log(
        root,
        "run",
        at(0.0, "run", cores=2, farm=farm),
        at(1.0, "begin", "simulate", threads=1),
        frame(load * 3.0, "simulate", 1, load * 1.5, cpu=1.5),
        at(3.0, "work", "simulate", cpu=0.25),
        at(3.0, "end", "simulate", cpu=2.0),
        at(3.0, "begin", "render", threads=2),
        frame(load * 7.5, "render", 1, load * 4.0, cpu=6.0),
        at(7.5, "renewed", "render", cpu=7.0),
        frame(load * 7.5, "render", 2, 0.0, found=True, cpu=0.0),
        at(8.0, "end", "render", cpu=0.5),
        at(10.0, "ran", cpu=12.0),
    )
    statistics(root, 1, 3.0 * load, 1.0 * load, threads=2, cpu=1.5 / load)
    return RunReport.of(root, "run", cores=64)


def test_every_cpu_second_is_accounted_for(tmp_path: Path) -> None:
    spending = a_run(tmp_path)
    assert (spending.seconds, spending.cores) == (10.0, 2)
    assert spending.cpu_seconds == pytest.approx(
        {
            "simulate": 1.75,
            "rendering": 4.5,
            "building": 1.5,
            "render": 0.0,
            "starting": 1.75,
            "planning": 2.5,
        }
    )
    assert sum(spending.shares.values()) == pytest.approx(1.0)
    assert spending.share_of_cores == pytest.approx(12.0 / 20.0)
    assert spending.frames == {"simulate": 1, "render": 1}


def test_waiting_is_wall_time_minus_cpu_seconds_by_threads(tmp_path: Path) -> None:
    waiting = a_run(tmp_path).waiting
    assert waiting["rendering"] == pytest.approx(3.0 - 4.5 / 2)
    assert waiting["building"] == pytest.approx(1.0 - 1.5 / 2)
    assert "simulate" not in waiting


def test_load_changes_what_was_waited_and_not_what_was_spent(tmp_path: Path) -> None:
    idle, loaded = (a_run(tmp_path / str(load), load) for load in (1.0, 5.0))
    assert loaded.cpu_seconds == pytest.approx(idle.cpu_seconds)
    assert loaded.waiting["rendering"] == pytest.approx(15.0 - 4.5 / 2)
    assert loaded.waiting["simulate"] == pytest.approx(7.5 - 1.75)


def test_on_a_farm_the_nodes_count_apart_from_the_process_that_waits_for_them(tmp_path: Path) -> None:
    spending = a_run(tmp_path, farm=True)
    assert spending.cpu_seconds["planning"] == pytest.approx(12.0)
    assert spending.cpu_seconds["rendering"] == pytest.approx(4.5)
    assert spending.share_of_cores is None


def test_what_interrupted_jobs_took_is_not_taken_for_planning(tmp_path: Path) -> None:
    log(
        tmp_path,
        "run",
        {"time": 0.0, "event": "run", "cores": 2, "farm": False},
        {"time": 1.0, "event": "begin", "job": "render", "stage": "render", "threads": 1},
        frame(2.0, "render", 1, 1.0, cpu=1.0),
        {"time": 9.0, "event": "ran", "cpu": 8.0},
    )
    assert RunReport.of(tmp_path, "run", cores=1).cpu_seconds == {
        "render": 1.0,
        "starting": 0.0,
        "unended": 7.0,
    }


def test_old_logs_show_the_most_that_it_can_have_been(tmp_path: Path) -> None:
    spending = an_old_run(tmp_path)
    assert not spending.is_counted and spending.waiting == {} and spending.share_of_cores is None
    assert spending.cpu_seconds == pytest.approx(
        {"simulate": 1.5, "rendering": 6.0, "building": 2.0, "render": 0.0, "starting": 2.5, "planning": 8.0}
    )


def test_one_line_names_the_largest_parts_first(tmp_path: Path) -> None:
    said = a_run(tmp_path).in_brief()
    assert said.startswith("rendering: light and auxiliary AOVs 38%, planning, Snakemake 21%")


def test_a_job_that_was_killed_held_its_core_to_the_end(tmp_path: Path) -> None:
    log(
        tmp_path,
        "run",
        {"time": 0.0, "event": "run", "cores": 1},
        {"time": 1.0, "event": "begin", "job": "render", "threads": 1},
        {"time": 5.0, "event": "ran"},
    )
    assert RunReport.of(tmp_path, "run", cores=1).cpu_seconds == {
        "render": 0.0,
        "starting": 4.0,
        "unended": 1.0,
    }


def test_a_run_that_left_no_log_is_told_with_those_that_did(tmp_path: Path) -> None:
    with pytest.raises(MissingInputError, match="no runs logged yet"):
        named_run(tmp_path, None)
    log(tmp_path, "20260101-1")
    log(tmp_path, "20260102-2")
    assert named_run(tmp_path, None) == "20260102-2"
    with pytest.raises(MissingInputError, match="'x' not found; the latest are 20260101-1, 20260102-2"):
        named_run(tmp_path, "x")


def plan_of(*jobs: Job, quality: str = "draft", settings: tuple[str, ...] = ()) -> Plan:
    request = RenderRequest(ShotSource(SHOT, Path("/shots/A.yaml"), settings), quality, "none", ())
    return Plan((request,), None, jobs)


def test_estimates_go_by_cpu_seconds_where_they_were_counted(tmp_path: Path) -> None:
    a_run(tmp_path, load=5.0)
    jobs = (Job("s", "simulate", (0,), (1, 2)), Job("r", "render", (0,), (1, 2)))
    expected = estimate(plan_of(*jobs), tmp_path, cores=2)
    assert expected.core_seconds == pytest.approx({"simulate": 2 * 1.5, "render": 2 * 6.0})


def test_time_limits_of_a_farm_go_by_wall_time(tmp_path: Path) -> None:
    statistics(tmp_path, 1, 60.0, 0.0, threads=2, cpu=0.5)
    limits = MeasuredResources.of(tmp_path / PLACE / "statistics", pixels=1)
    assert limits is not None and limits.seconds == pytest.approx(120.0)


def test_frames_of_the_same_kind_tell_what_frames_will_take(tmp_path: Path) -> None:
    an_old_run(tmp_path)
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
