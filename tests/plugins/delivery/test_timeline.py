"""An edit as editing programs read it: every frame of the film is where the film has it."""

from __future__ import annotations

import wave
from pathlib import Path

import opentimelineio as otio
import pytest

from tests.conftest import QUALITY

NAME = "T010_tiny"
REEL = f"""\
title: Reel
shots:
  - {{shot: {NAME}, dissolve: 3}}
  - {{card: Part two, seconds: 1}}
  - {{shot: {NAME}, frames: "6,4,2,1-5x2"}}
  - {{shot: {NAME}, frames: 2-6, dissolve: 2}}
title_seconds: 0.5
credits_seconds: 0
"""


@pytest.fixture
def there(project, monkeypatch):
    (project.path / "shots" / "reel.yaml").write_text(REEL)
    monkeypatch.chdir(project.path)
    return project


def exported(there, *words: str) -> otio.schema.Timeline:
    done = there.call("export", "otio", "reel", "-q", QUALITY, *words)
    assert done.code == 0, done.err
    return otio.adapters.read_from_file(words[words.index("-o") + 1] if "-o" in words else "reel.otio")


def seen(timeline: otio.schema.Timeline) -> list[tuple[str, list[int]]]:
    """Return the frames of each clip, in order."""
    shown = []
    for clip in timeline.find_clips():
        first, count = clip.source_range.start_time.to_frames(), clip.source_range.duration.to_frames()
        step = round(clip.effects[0].time_scalar) if clip.effects else 1
        shown.append((clip.name, [first + step * n for n in range(count)]))
    return shown


def test_clips_dissolves_and_cards_come_back(there):
    timeline = exported(there)
    kinds = [type(part).__name__ for part in timeline.tracks[0]]
    assert kinds == ["Clip", "Transition", "Clip", "Clip", "Clip", "Clip", "Transition", "Clip"]
    assert timeline.duration() == otio.opentime.RationalTime(12 + 6 + 24 + 6 + 5 - 3 - 2, 24)
    assert timeline.global_start_time == otio.opentime.RationalTime(86400, 24)
    assert seen(timeline) == [
        ("Reel", list(range(10))),
        (NAME, [2, 3, 4, 5, 6]),
        ("Part two", list(range(24))),
        (NAME, [6, 4, 2]),
        (NAME, [1, 3]),
        (NAME, [3, 4, 5, 6]),
    ]


def test_a_dissolve_has_its_frames_on_both_sides_of_the_cut(there):
    parts = list(exported(there).tracks[0])
    for index, part in enumerate(parts):
        if isinstance(part, otio.schema.Transition):
            before, after = parts[index - 1], parts[index + 1]
            left = before.available_range().end_time_exclusive() - before.source_range.end_time_exclusive()
            lead = after.source_range.start_time - after.available_range().start_time
            assert left >= part.out_offset
            assert lead >= part.in_offset


def test_media_lie_where_the_timeline_says(finished, monkeypatch):
    monkeypatch.chdir(finished.path)
    Path("shots/reel.yaml").write_text(REEL)
    Path("cuts").mkdir()
    clip = next(c for c in exported(finished, "-o", "cuts/reel.otio").find_clips() if c.name == NAME)
    media = clip.media_reference
    assert all((Path("cuts") / media.target_url_for_image_number(n)).is_file() for n in range(6))
    assert media.target_url_for_image_number(0) == f"../renders/{NAME}/{QUALITY}/frames/{NAME}.0001.exr"
    assert finished.call("deliver", NAME, "-q", QUALITY, "--as", "prores4444").code == 0
    clip = next(c for c in exported(finished, "--media", "prores4444").find_clips() if c.name == NAME)
    assert Path(clip.media_reference.target_url).is_file()
    assert clip.available_range() == clip.media_reference.available_range


def test_sound_lies_on_a_track_of_its_own(there):
    tone = Path("shots/a tone.wav")
    with wave.open(str(tone), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(48000)
        file.writeframes(bytes(2 * 24000))
    Path("shots/reel.yaml").write_text(REEL + "sound: {file: a tone.wav, start: 1, gain: -3}\n")
    timeline = exported(there)
    (track,) = timeline.audio_tracks()
    gap, clip = track
    assert gap.duration().to_seconds() == 1.0
    assert clip.media_reference.target_url == "shots/a%20tone.wav"
    assert clip.duration().to_seconds() == 0.5
    assert clip.metadata["flowsculpt"]["gain"] == -3.0


def test_the_same_edit_is_the_same_file(there):
    files = []
    for name in ("a.otio", "b.otio"):
        exported(there, "-o", name)
        files.append(Path(name).read_bytes().replace(name.encode(), b""))
    assert files[0] == files[1]


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        (("otio", "rel"), 3, "shots/rel.yaml: no such edit; did you mean reel?"),
        (("otio", "reel", "--media", "prores"), 2, "Did you mean 'prores4444'?"),
        (("otio", "reel", "-o", "reel.xml"), 2, "a timeline's name ends in .otio"),
        (("otoi", "reel"), 2, "Did you mean 'otio'?"),
    ],
)
def test_what_cannot_be_exported_is_told_in_one_line(there, words, code, says):
    done = there.call("export", *words)
    assert done.code == code
    assert says in done.err
    assert len(done.err.strip().splitlines()) == 1
