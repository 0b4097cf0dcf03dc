"""The event log, as who reads a part of it sees it."""

from __future__ import annotations

from pathlib import Path

import pytest

from flowsculpt.pipeline.production.store.event_log import EventLog, EventReader

pytestmark = pytest.mark.quick


def test_who_looks_for_one_job_is_told_of_no_other_and_misses_none(tmp_path: Path) -> None:
    path = tmp_path / "run.jsonl"
    for name in ("render_0001_Zwölf", "render_00011_Zwölf", "finish_0002"):
        for number in range(3):
            EventLog(path, name).write("frame", frame=number)
    reader = EventReader(path)
    told = list(reader.new("render_0001_Zwölf"))
    assert [event["job"] for event in told] == ["render_0001_Zwölf"] * 3
    assert not list(reader.new())
    EventLog(path, "finish_0002").write("fail", message="no")
    assert [event["message"] for event in reader.new("fail")] == ["no"]
