"""Movies, films and deliveries carry the sounds of shots, in step with their pictures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.arrays import Floats
from flowsculpt.pipeline.production.request.audio import AudioClip
from flowsculpt.pipeline.production.request.edit import Edit
from flowsculpt.pipeline.shot import read_film
from tests.conftest import ProjectFolder
from tests.sounds import RATE, sine, times, write_sound

NAME = "T010_tiny"
FRAME = RATE // 24


def sounding(project: ProjectFolder) -> ProjectFolder:
    """Give a shot of 6 frames a sound with a burst in the middle of its third frame."""
    burst = (times(1) * 24 >= 2.5) & (times(1) * 24 < 3.0)
    write_sound(project.path / "shots/burst.wav", np.where(burst, sine(3000, 1), 0.0))
    project.shot.write_text(project.shot.read_text() + "sound: {file: burst.wav}\n")
    return project


def film_of(folder: Path, text: str) -> tuple[Edit, Floats]:
    """Return the edit of a film file, and the left channel of its sound."""
    (folder / "reel.yaml").write_text(f"title: R\ntitle_seconds: 0\n{text}")
    edit = Edit.of(read_film(folder / "reel.yaml"), "reel")
    parts = AudioClip.mix(edit.sounds, edit.length, edit.frame_rate)
    assert parts is not None
    return edit, np.concatenate(list(parts), axis=1)[0]


def test_a_film_has_the_sounds_of_its_shots_where_they_stand(project: ProjectFolder) -> None:
    shot = sounding(project).shot.parent
    edit, samples = film_of(
        shot,
        f"shots: [{{card: One, seconds: 0.5}}, {NAME}, {{shot: {NAME}, frames: 3-6, dissolve: 1}}, "
        f"{{shot: {NAME}, frames: 1-5x2}}]\n",
    )
    assert len(samples) == edit.length * FRAME == (12 + 6 - 1 + 4 + 3) * FRAME
    loud = np.flatnonzero(samples)
    runs = np.split(loud, np.flatnonzero(np.diff(loud) > 100) + 1)
    first, second = 12 * FRAME, (12 + 6 - 1) * FRAME
    assert [run[0] - 1 for run in runs] == [first + 2.5 * FRAME, second + 0.5 * FRAME]  # 1-5x2 is silent
    assert samples[runs[0]].max() == pytest.approx(0.5, abs=1e-3)
    assert 0.2 < samples[runs[1]].max() < 0.5  # within the dissolve


def test_a_films_own_sound_replaces_those_of_its_shots(project: ProjectFolder) -> None:
    folder = sounding(project).shot.parent
    write_sound(folder / "tone.wav", np.full(RATE, 0.25))
    _, samples = film_of(folder, f"shots: [{NAME}]\nsound: {{file: tone.wav}}\n")
    np.testing.assert_allclose(samples, 0.25, atol=1e-5)


def test_an_edit_is_read_again_when_the_sound_of_a_shot_changes(project: ProjectFolder) -> None:
    folder = sounding(project).shot.parent
    before = film_of(folder, f"shots: [{NAME}]\n")[0]
    write_sound(folder / "burst.wav", sine(500, 1))
    after = film_of(folder, f"shots: [{NAME}]\n")[0]
    assert before.items == after.items and before.clips != after.clips
