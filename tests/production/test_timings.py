"""Timings of a run by activity, and estimates from timings measured on this machine."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

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


def record_an_old_run(root: Path) -> None:
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


def record_a_run(root: Path, load: float = 1.0, farm: bool = False) -> None:
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


def plan_of(*jobs: Job, quality: str = "draft", settings: tuple[str, ...] = ()) -> Plan:
    request = RenderRequest(ShotSource(SHOT, Path("/shots/A.yaml"), settings), quality, "none", ())
    return Plan((request,), None, jobs)


def test_estimates_go_by_cpu_seconds_where_they_were_counted(tmp_path: Path) -> None:
    record_a_run(tmp_path, load=5.0)
    jobs = (Job("s", "simulate", (0,), (1, 2)), Job("r", "render", (0,), (1, 2)))
    expected = estimate(plan_of(*jobs), tmp_path, cores=2)
    assert expected.core_seconds == pytest.approx({"simulate": 2 * 1.5, "render": 2 * 6.0})


def test_time_limits_of_a_farm_go_by_wall_time(tmp_path: Path) -> None:
    statistics(tmp_path, 1, 60.0, 0.0, threads=2, cpu=0.5)
    limits = MeasuredResources.of(tmp_path / PLACE / "statistics", pixels=1)
    assert limits is not None and limits.seconds == pytest.approx(120.0)


def test_frames_of_the_same_kind_tell_what_frames_will_take(tmp_path: Path) -> None:
    record_an_old_run(tmp_path)
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
