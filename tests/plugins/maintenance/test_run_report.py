"""Where the CPU seconds of a run went."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from flowsculpt.pipeline.errors import MissingInputError
from flowsculpt.pipeline.plugins.maintenance.run_report import RunReport, named_run
from tests.production.test_timings import frame, log, record_a_run, record_an_old_run

pytestmark = pytest.mark.quick


def a_run(root: Path, load: float = 1.0, farm: bool = False) -> RunReport:
    """Record a run, and return its report."""
    record_a_run(root, load, farm)
    return RunReport.of(root, "run", cores=64)


def an_old_run(root: Path) -> RunReport:
    """Record a run of an earlier version, and return its report."""
    record_an_old_run(root)
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


def test_the_report_accounts_for_a_whole_run(finished_project):
    facts = json.loads(finished_project.call("report", "--json").out)
    spent = facts["cpu_seconds"]
    assert {"simulate", "building", "rendering", "finish", "assemble", "film", "planning"} <= set(spent)
    most = 1.1 * facts["seconds"] * (os.cpu_count() or 1)
    assert facts["is_counted"] and 1.0 < sum(spent.values()) <= most, "no second is counted twice"
    assert facts["frames"]["render"] == 6
    words = finished_project.call("report", facts["run"]).out
    assert "rendering: light and auxiliary AOVs" in words and "starting and ending jobs" in words


def test_a_run_that_is_not_there_is_told_in_one_line(finished_project):
    done = finished_project.call("report", "yesterday")
    assert done.code == 3
    assert done.err.count("\n") == 1 and "yesterday" in done.err
