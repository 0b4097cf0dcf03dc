"""Estimates before a run and costs after it, as the command prints them."""

from __future__ import annotations

import json
import re
import signal

import pytest

from tests.conftest import QUALITY

NAME = "T010_tiny"


@pytest.fixture(scope="module")
def told(finished_project):
    """Return the estimate of a quality that was not made yet: as text, and as JSON."""
    words = finished_project.call("--dry-run", "render", NAME, "-q", "daily").out
    facts = json.loads(finished_project.call("--json", "--dry-run", "render", NAME, "-q", "daily").out)
    return words, facts["estimate"]


def test_a_dry_run_says_how_long_and_how_large(told):
    words, facts = told
    assert "It takes about" in words and f"6 frames of {NAME} at {QUALITY}" in words
    assert "It needs" in words and "that are free" in words
    assert facts["seconds"] > 1.0 and facts["unmeasured"] == []
    assert 4e6 < facts["bytes"] < 4e8


def test_where_nothing_was_measured_a_dry_run_says_so(project):
    words = project.call("--dry-run", "render", NAME, "-q", "draft").out
    assert "is not known: none was done here yet" in words


def test_stills_say_what_large_frames_take_before_any_is_rendered(project):
    process = project.start("stills", NAME, "-f", "2", "-q", "final")
    try:
        said = process.stderr.readline()
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=300)
    assert "1 frame of 1920 × 1080 pixels, at most 64 samples each" in said
    assert re.search(r"about .* (s|min) on . cores?, by a typical shot; none was rendered here yet\.", said)


def test_stills_of_a_draft_say_nothing_of_their_cost(finished):
    done = finished.call("stills", NAME, "-f", "2", "-q", QUALITY)
    assert done.code == 0 and "To be rendered" not in done.err
