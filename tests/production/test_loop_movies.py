"""Movies of shots that loop."""

from __future__ import annotations

import av
import pytest

from flowsculpt.pipeline.frames import FrameRange
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.render.movie.encode import LOOPS
from flowsculpt.render.movie.movie_frames import loop_frames
from tests.conftest import QUALITY
from tests.needed_plugins import needs_plugins

DISSOLVE = "loop={dissolve: 2}"


def movie(path) -> tuple[int, str]:
    with av.open(str(path)) as container:
        comment = container.metadata.get("comment", "")
        return sum(1 for _ in container.decode(video=0)), comment


def test_the_end_of_a_loop_is_mixed_with_the_frames_before_its_beginning(project):
    request = Project(project.path, 1, settings=(DISSOLVE,)).request(project.shot, QUALITY)
    mixed = loop_frames(
        [1, 2, 3, 4, 5, 6], request.loop_dissolve, iter, lambda a, b, weight: (a, b, round(weight, 3))
    )
    assert list(mixed) == [3, 4, (5, 1, 0.333), (6, 2, 0.667)]
    plain = Project(project.path, 1).request(project.shot, QUALITY)
    assert list(loop_frames([1, 2, 3], plain.loop_dissolve, iter, max)) == [1, 2, 3]
    part = Project(project.path, 1, settings=(DISSOLVE,)).request(
        project.shot, QUALITY, FrameRange.parse("2-5")
    )
    assert list(loop_frames([2, 3, 4, 5], part.loop_dissolve, iter, max)) == [2, 3, 4, 5]


@needs_plugins("delivery", "maintenance")
def test_a_dissolve_is_encoded_from_the_frames_that_there_are(finished):
    plan = finished.render(settings=(DISSOLVE,))
    assert [job.stage for job in plan.jobs] == ["assemble"]
    path = finished.path / "renders" / "T010_tiny" / QUALITY / "T010_tiny.mp4"
    assert movie(path) == (4, LOOPS)
    delivered = finished.call("deliver", "T010_tiny", "-q", QUALITY, "--set", DISSOLVE, "--as", "review,webp")
    assert delivered.code == 0, delivered.err
    folder = path.parent / "deliver"
    assert movie(next(folder.glob("*.review.mp4"))) == (4, LOOPS)
    assert b"ANIM" in next(folder.glob("*.webp")).read_bytes()[:64]
    kept = finished.call("clean", "--dry-run", "--set", DISSOLVE)
    assert kept.code == 0, kept.err


@pytest.mark.quick
def test_a_loop_in_whole_turns_changes_cameras_alone(project):
    """Meshes stay: only the camera and what rests on it is another one where the first frame follows."""
    plain, round_ = (
        Project(project.path, 1, settings=settings).request(project.shot, QUALITY)
        for settings in ((), ("loop=turns",))
    )
    assert plain.source.surface_keys.meshes == round_.source.surface_keys.meshes
    assert plain.keys.cameras != round_.keys.cameras
    assert round_.pictures.is_round
