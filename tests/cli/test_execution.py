"""What a command says of runs that failed."""

from flowsculpt.pipeline.cli.execution import _failure


def test_a_job_that_was_killed_before_its_first_frame_is_named():
    event = {"event": "fail", "job": "film_a", "message": "the process was killed by signal 11"}
    assert _failure(event) == "film_a: the process was killed by signal 11"
    assert _failure({**event, "shot": "a", "frame": 3}) == "a frame 3: the process was killed by signal 11"
