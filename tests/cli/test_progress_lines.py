"""Lines of progress, printed where no bars can be drawn."""

from __future__ import annotations

import io
import time

import pytest
from rich.console import Console

from pipeline.cli import output
from pipeline.cli.output import ProgressLines

pytestmark = pytest.mark.quick


def lines_of(seconds: float, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return the lines that are printed within so many seconds, one each 0.05 s, of a frame in work."""
    monkeypatch.setattr(output, "LINE_SECONDS", 0.05)
    text = io.StringIO()
    with ProgressLines(Console(file=text, width=40)) as progress:
        simulating = progress.add_task("simulating", total=72, now="")
        progress.add_task("drawing", total=72, now="")
        progress.update(simulating, completed=12.45, now="frame 13 (45%, curl_noise) with a long name")
        time.sleep(seconds)
    return text.getvalue().splitlines()


def test_a_frame_in_work_is_told_again_and_again(monkeypatch: pytest.MonkeyPatch) -> None:
    lines = lines_of(0.3, monkeypatch)
    assert len(lines) >= 2, "one long line is not broken either"
    told = "simulating: 12 of 72 after 0:00:00, frame 13 (45%, curl_noise) with a long name"
    assert set(lines) == {told}


def test_what_is_soon_done_says_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    assert lines_of(0.0, monkeypatch) == []
