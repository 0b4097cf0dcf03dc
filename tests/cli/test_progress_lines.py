"""Lines of progress, printed where no bars can be drawn."""

from __future__ import annotations

import io
import re
import time

import pytest
from rich.console import Console

from flowsculpt.pipeline.cli import output
from flowsculpt.pipeline.cli.output import ProgressLines

pytestmark = pytest.mark.quick


def lines_of(least: int) -> list[str]:
    """Return the lines that are printed of a frame in work, once there are at the least so many."""
    text, limit = io.StringIO(), time.monotonic() + 120.0
    with ProgressLines(Console(file=text, width=40)) as progress:
        simulating = progress.add_task("simulating", total=72, now="")
        progress.add_task("drawing", total=72, now="")
        progress.update(simulating, completed=12.45, now="frame 13 (45%, curl_noise) with a long name")
        while text.getvalue().count("\n") < least:
            assert time.monotonic() < limit, text.getvalue()
            time.sleep(0.01)
    return text.getvalue().splitlines()


def test_a_frame_in_work_is_told_again_and_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(output, "LINE_SECONDS", 0.05)
    told = r"simulating: 12 of 72 after 0:0\d:\d\d, frame 13 \(45%, curl_noise\) with a long name"
    for line in lines_of(2):
        assert re.fullmatch(told, line), "a long line is not broken either"


def test_what_is_done_before_a_line_is_due_says_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(output, "LINE_SECONDS", 3600.0)
    assert lines_of(0) == []
