"""The sounds of shots in a timeline: where movies have them, with their files, and back in an edit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import opentimelineio as otio
import pytest

from flowsculpt.pipeline.errors import ShotError
from flowsculpt.pipeline.frames import FrameRange
from flowsculpt.pipeline.plugins.delivery.imported_edit import ImportedEdit
from flowsculpt.pipeline.plugins.delivery.timeline import Timeline
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.request.audio import samples_of
from flowsculpt.pipeline.production.request.edit import Edit
from flowsculpt.pipeline.shot import read_film
from tests.conftest import ProjectFolder
from tests.sounds import RATE, write_sound

NAME = "T010_tiny"
FRAME = RATE // 24
CUT = f"""\
title: Cut
title_seconds: 0
shots:
  - {{card: One, seconds: 0.5}}
  - {NAME}
  - {{shot: {NAME}, frames: 3-6, dissolve: 2}}
  - {{card: Two, seconds: 0.5}}
"""


@pytest.fixture
def timeline(project: ProjectFolder, monkeypatch: pytest.MonkeyPatch) -> otio.schema.Timeline:
    """The timeline of an edit of a shot that has two sounds, as its file says; it is cut.otio."""
    monkeypatch.chdir(project.path)
    write_sound(project.path / "shots/a tone.wav", np.full(RATE, 0.25))
    project.shot.write_text(project.shot.read_text() + "sound: {file: a tone.wav, start: -0.125, gain: -3}\n")
    (project.path / "shots/reel.yaml").write_text(CUT)
    edit = Edit.of(read_film(Path("shots/reel.yaml")), "cut")
    ranges = map(FrameRange.parse, ("1-6", "3-6"))
    clips = [Project(project.path, 2).request(project.shot, "draft", frames) for frames in ranges]
    Timeline(edit, clips, project.path, "frames", project.path / "cut.otio").write()
    return otio.adapters.read_from_file("cut.otio")


def test_sounds_of_shots_lie_at_the_samples_of_the_film(timeline: otio.schema.Timeline) -> None:
    heard = np.zeros(24 * RATE)
    for track in timeline.audio_tracks():
        otio.algorithms.track_with_expanded_transitions(track)  # raises where a transition has no handles
        for clip in track.find_clips():
            assert clip.available_range().contains(clip.source_range)
            assert Path(clip.media_reference.target_url.replace("%20", " ")).is_file()
            place = clip.range_in_parent()
            first, count = place.start_time.to_frames(), place.duration.to_frames()
            heard[first : first + count] += 1
            assert clip.source_range.start_time.to_frames() in (RATE // 8, RATE // 8 + 2 * FRAME)
    edit = Edit.of(read_film(Path("shots/reel.yaml")), "cut")
    parts = samples_of(edit.sounds, edit.length, edit.frame_rate)
    assert parts is not None
    film = np.concatenate(list(parts), axis=1)[0]
    assert (heard[: len(film)] > 0).tolist() == (film != 0.0).tolist()
    assert timeline.duration().to_frames() == edit.length


def test_sounds_of_shots_come_back_as_those_of_the_shots(timeline: otio.schema.Timeline) -> None:
    assert len(timeline.audio_tracks()) == 2  # they dissolve
    text = ImportedEdit(Path("cut.otio"), (NAME,), Path("shots")).text()
    assert "sound" not in text
    Path("shots/again.yaml").write_text(text.split("\n", 1)[1])
    before, after = (Edit.of(read_film(Path(f"shots/{name}.yaml")), "cut") for name in ("reel", "again"))
    assert after.clips == before.clips and after.items == before.items


def test_a_sound_of_a_shot_that_was_moved_is_refused(timeline: otio.schema.Timeline) -> None:
    gap = timeline.audio_tracks()[1][0]
    gap.source_range = otio.opentime.TimeRange(duration=gap.duration() + otio.opentime.RationalTime(2, 24))
    otio.adapters.write_to_file(timeline, "cut.otio")
    with pytest.raises(ShotError, match=r"cut\.otio: a tone is .*not where shot T010_tiny has it"):
        ImportedEdit(Path("cut.otio"), (NAME,), Path("shots")).text()


def test_a_sound_of_the_film_beside_those_of_shots_is_refused(timeline: otio.schema.Timeline) -> None:
    timeline.audio_tracks()[0].find_clips()[0].metadata.clear()
    otio.adapters.write_to_file(timeline, "cut.otio")
    with pytest.raises(ShotError, match="either its own sound or theirs"):
        ImportedEdit(Path("cut.otio"), (NAME,), Path("shots")).text()
