"""What stands in a timeline is in the edit as the editor sees it, or refused with its place."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import opentimelineio as otio
import pytest
from opentimelineio import opentime, schema

from flowsculpt.pipeline.errors import FlowsculptError, ShotError
from flowsculpt.pipeline.plugins.delivery.imported_edit import ImportedEdit
from flowsculpt.pipeline.plugins.delivery.timeline_import import edit_of

Span, Parts = opentime.TimeRange, tuple[Any, ...]
FPS = 24.0
SAMPLES = 48_000.0


def span(first: float, count: float, rate: float = FPS) -> opentime.TimeRange:
    return opentime.TimeRange(opentime.RationalTime(first, rate), opentime.RationalTime(count, rate))


def frames(
    shot: str = "A",
    first: int = 1,
    available: Span | None = None,
    rate: float = FPS,
    step: int = 1,
) -> schema.ImageSequenceReference:
    """Refer to the frames of a shot; the first file has the number `first`."""
    return schema.ImageSequenceReference(
        "frames/", f"{shot}.", ".exr", first, step, rate, 4, available_range=available
    )


def clip(media: Any = None, source: Span | None = None, enabled: bool = True, **values: Any) -> schema.Clip:
    part = schema.Clip("A", media, span(2, 3) if source is None else source, **values)
    part.enabled = enabled
    return part


def movie(url: str, available: Span | None) -> schema.ExternalReference:
    return schema.ExternalReference(url, available)


def saved(folder: Path, *parts: Any, sounds: Parts = (), change: Callable[[Any], object] = str) -> Path:
    timeline = schema.Timeline("Cut")
    timeline.tracks.append(schema.Track("v1", kind=schema.TrackKind.Video))
    timeline.tracks[0].extend(parts)
    if sounds:
        timeline.tracks.append(schema.Track("a1", kind=schema.TrackKind.Audio))
        timeline.tracks[1].extend(sounds)
    change(timeline)
    otio.adapters.write_to_file(timeline, str(folder / "cut.otio"))
    return folder / "cut.otio"


def text_of(file: Path) -> str:
    return ImportedEdit(file, ("A", "B"), file.parent, {"A": "1-48"}).text()


def transition(kind: str = "SMPTE_Dissolve", name: str = "Cross Dissolve") -> schema.Transition:
    return schema.Transition(name, kind, opentime.RationalTime(1, FPS), opentime.RationalTime(1, FPS))


def switched(key: str) -> schema.Clip:
    """Return a clip of two media, of which one is chosen."""
    part = clip()
    part.name = "take 2"
    media = {"one": frames("A", available=span(1, 9)), "two": frames("B", 5, span(1, 9))}
    part.set_media_references(media, key)
    return part


def speed(scalar: float, is_on: bool = True) -> schema.LinearTimeWarp:
    effect = schema.LinearTimeWarp(time_scalar=scalar)
    effect.enabled = is_on
    return effect


@pytest.mark.parametrize(
    ("part", "shown"),
    [
        (clip(), "shot: A, frames: 2-4"),
        (clip(frames(first=1, available=span(0, 8))), "shot: A, frames: 3-5"),
        (clip(frames(first=1, available=span(1, 8))), "shot: A, frames: 2-4"),
        (clip(frames(first=1001, available=span(0, 8))), "shot: A, frames: 1003-1005"),
        (clip(frames(first=1, available=span(86400, 8)), span(86402, 3)), "shot: A, frames: 3-5"),
        (clip(frames(first=0)), "shot: A, frames: 2-4"),
        (clip(frames(first=-4, available=span(0, 8))), "shot: A, frames: -2-0"),
        (clip(frames(first=1, available=span(0, 8)), span(2 / 24, 3 / 24, 1.0)), "shot: A, frames: 3-5"),
        (clip(frames(first=1, available=span(0, 8)), span(4000, 6000, SAMPLES)), "shot: A, frames: 3-5"),
        (clip(movie("A.1-48.prores4444.mov", span(0, 48))), "shot: A, frames: 3-5"),
        (clip(movie("A.1-48.prores4444.mov", span(86400, 48)), span(86401, 3)), "shot: A, frames: 2-4"),
        (clip(movie("A.10-48_360.h264.mp4", span(10, 39)), span(12, 3)), "shot: A, frames: 12-14"),
        (clip(movie("A.mov", span(1, 48))), "shot: A, frames: 2-4"),
        (clip(movie("A.mov", span(0, 48))), "shot: A, frames: 3-5"),
        (clip(movie("renders/A.mov", span(86400, 48)), span(86402, 3)), "shot: A, frames: 3-5"),
        (clip(movie("A.mov", span(10, 9)), span(12, 3)), "shot: A, frames: 12-14"),
        (clip(schema.MissingReference(available_range=span(86400, 8)), span(86402, 3)), "frames: 3-5"),
        (clip(schema.MissingReference()), "shot: A, frames: 2-4"),
        (switched("one"), "shot: A, frames: 2-4"),
        (switched("two"), "shot: B, frames: 6-8"),
        (clip(effects=[speed(2.0)]), "shot: A, frames: 2-6x2"),
        (clip(effects=[speed(-1.0)]), "frames: 2,1,0"),
        (clip(effects=[speed(2.0, is_on=False)]), "shot: A, frames: 2-4"),
        (clip(markers=[schema.Marker("note")]), "shot: A, frames: 2-4"),
    ],
)
def test_a_clip_shows_the_frames_of_its_media(part: schema.Clip, shown: str, tmp_path: Path) -> None:
    text = text_of(saved(tmp_path, part)).replace("'", "")
    assert shown in text
    media = part.media_reference
    if isinstance(media, schema.ImageSequenceReference) and media.available_range is not None:
        assert f"frames: {media.frame_for_time(part.source_range.start_time)}-" in text


@pytest.mark.parametrize(
    ("parts", "told"),
    [
        ([clip(enabled=False)], "0 tracks of pictures"),
        ([clip(), clip(enabled=False)], r"entry 2 \(A\): it is disabled, which leaves a gap"),
        ([clip(), schema.Gap("", span(0, 2))], r"entry 2 \(Gap\): it is a Gap"),
        ([clip(frames())], "no available_range, which says where"),
        ([clip(movie("A.mov", None))], "no available_range, which says where"),
        (
            [clip(frames(available=span(0, 8), rate=12.0))],
            "its media has 12 pictures a second, and the film 24",
        ),
        ([clip(movie("A.1-48.mov", span(0, 8, 25.0)))], "its media has 25 pictures a second"),
        ([clip(frames(available=span(0, 8), step=2))], "one file for 2 frames"),
        ([clip(), clip(source=span(1, 2, 25.0))], "at frame 1.92 of 24 a second, between two"),
        ([clip(frames("B", available=span(1, 8)))], "it is called A and its media is of B"),
        (
            [clip(), transition("Custom_Transition", "Wipe"), clip()],
            r"entry 2 \(Wipe\): it is a transition 'Wipe'",
        ),
        ([clip(), transition("SMPTE_Wipe", ""), clip()], "it is a transition 'SMPTE_Wipe'"),
        ([clip(), transition(name="Edge Wipe"), clip()], "it is a transition 'Edge Wipe'"),
        ([transition(), clip()], "a dissolve without a clip on both sides"),
        ([clip(), transition()], "a dissolve without a clip on both sides"),
        ([clip(effects=[schema.FreezeFrame()])], "an effect other than a whole speed"),
        ([clip(effects=[speed(0.5)])], "an effect other than a whole speed"),
        ([clip(effects=[speed(float("inf"))])], "an effect other than a whole"),
        ([clip(effects=[schema.Effect("blur")])], "an effect other than a whole speed"),
        ([clip(schema.GeneratorReference("bars", "SMPTEBars", span(0, 9)))], "it is a generator 'SMPTEBars'"),
        ([clip(), clip(source=span(1e308, 2))], r"1e\+308 at 24 a second is out of range"),
        ([clip(), clip(source=span(float("nan"), 2))], "is out of range"),
        ([clip(), clip(source=span(1, 2, -24.0))], "is out of range"),
        ([clip(), clip(source=span(1, 2, 0.0))], "is out of range"),
        ([clip(), clip(source=span(1, 0))], "it shows 0 frames"),
        ([clip(source=span(1, 2, 0.0))], "frame rate 0"),
    ],
)
def test_what_an_edit_cannot_show_is_refused_with_its_place(
    parts: list[Any], told: str, tmp_path: Path
) -> None:
    with pytest.raises(ShotError, match=told) as refused:
        text_of(saved(tmp_path, *parts))
    assert "\n" not in str(refused.value) and "cut.otio: " in str(refused.value)


def trimmed(timeline: schema.Timeline) -> None:
    timeline.tracks[0].source_range = span(0, 1)


def disabled(timeline: schema.Timeline) -> None:
    timeline.tracks.enabled = False


def sped_up(timeline: schema.Timeline) -> None:
    timeline.tracks[0].effects.append(speed(2.0))


def in_a_stack(timeline: schema.Timeline) -> None:
    timeline.tracks.append(schema.Stack("titles", [clip()]))


def on_two_tracks(timeline: schema.Timeline) -> None:
    timeline.tracks.append(schema.Track("v2", [clip()], kind=schema.TrackKind.Video))


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (trimmed, "track v1 is trimmed"),
        (disabled, "0 tracks of pictures"),
        (sped_up, "track v1 has an effect"),
        (in_a_stack, "'titles' is a Stack among its tracks"),
        (on_two_tracks, "it has 2 tracks of pictures"),
    ],
)
def test_tracks_that_an_edit_cannot_have_are_refused(
    change: Callable[[Any], object], told: str, tmp_path: Path
) -> None:
    with pytest.raises(ShotError, match=told):
        text_of(saved(tmp_path, clip(), change=change))


def test_a_disabled_track_is_left_out(tmp_path: Path) -> None:
    def change(timeline: schema.Timeline) -> None:
        on_two_tracks(timeline)
        timeline.tracks[1].enabled = False

    assert text_of(saved(tmp_path, clip(), change=change)) == text_of(saved(tmp_path, clip()))


def sound(first: float, seconds: float, available: Span | None, **values: Any) -> schema.Clip:
    source = span(first * SAMPLES, seconds * SAMPLES, SAMPLES)
    part = clip(movie("music.wav", available), source, **values)
    part.name = "music"
    return part


LONG = span(86400 * SAMPLES, 20 * SAMPLES, SAMPLES)
"""Of a sound whose timecode begins a day after midnight, as the clocks of recorders have it."""


@pytest.mark.parametrize(
    ("sounds", "start"),
    [
        ((sound(86400, 20, LONG),), 0.0),
        ((sound(86402, 18, LONG),), -2.0),
        ((schema.Gap("", span(0, 12)), sound(86400, 20, LONG)), 0.5),
        ((sound(0, 20, None),), 0.0),
        ((sound(86400, 20, LONG), sound(0, 1, None, enabled=False)), 0.0),
    ],
)
def test_a_sound_begins_where_the_timeline_has_it(sounds: Parts, start: float, tmp_path: Path) -> None:
    text = text_of(saved(tmp_path, clip(source=span(1, 48)), sounds=sounds))
    assert "file: music.wav" in text and f"start: {start}" in text


@pytest.mark.parametrize(
    ("sounds", "told"),
    [
        ((sound(5, 20, None),), "sound music: its media has no available_range"),
        ((sound(86400, 1, LONG),), "it ends before its file and before the film"),
        ((sound(1e308, 20, LONG),), "its times are out of range"),
        ((sound(86400, float("nan"), LONG),), "its times are out of range"),
        ((schema.Gap("", span(0, 12)), sound(86402, 18, LONG)), "begins within its file and within the film"),
        ((sound(86400, 20, LONG, effects=[schema.Effect("reverb")]),), "it has an effect"),
        ((schema.Gap("", span(0, 9)), transition(), sound(86400, 20, LONG)), "fades by a transition"),
        ((schema.Clip("lost", source_range=span(0, 9)),), "its media is a MissingReference"),
    ],
)
def test_a_sound_that_an_edit_would_have_at_other_times_is_refused(
    sounds: Parts, told: str, tmp_path: Path
) -> None:
    with pytest.raises(ShotError, match=told):
        text_of(saved(tmp_path, clip(source=span(1, 48)), sounds=sounds))


def test_movies_begin_with_the_frames_of_their_shots(tmp_path: Path) -> None:
    (tmp_path / "A.yaml").write_text("frames: 11-20\n")
    file = saved(tmp_path, clip(movie("A.mov", span(0, 10))))
    assert "shot: A, frames: 13-15" in edit_of(file, ("A", "B"), tmp_path)[1]


@pytest.mark.parametrize(
    "content",
    [
        "[" * 200_000,
        '{"a":' * 200_000,
        "{",
        "[1]",
        "NaN",
        '{"OTIO_SCHEMA": "Timeline.99"}',
        "{}",
        "",
    ],
)
def test_a_file_that_is_no_timeline_is_refused_in_one_line(content: str, tmp_path: Path) -> None:
    (tmp_path / "a.otio").write_text(content)
    with pytest.raises(FlowsculptError) as refused:
        edit_of(tmp_path / "a.otio", ("A",), tmp_path)
    assert isinstance(refused.value, ShotError) and "\n" not in str(refused.value)


def test_a_timeline_of_thousands_of_stacks_in_each_other_is_refused(tmp_path: Path) -> None:
    begin, child, end = saved(tmp_path, clip()).read_text().rpartition('"children": [')
    nested = '{"OTIO_SCHEMA": "Stack.1", "children": [' * 100_000 + "]}" * 100_000
    (tmp_path / "deep.otio").write_text(f"{begin}{child}{nested}, {end}")
    with pytest.raises(ShotError, match="too many brackets"):
        edit_of(tmp_path / "deep.otio", ("A",), tmp_path)
