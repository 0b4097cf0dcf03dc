"""The cut of an editing program as an edit: the same frames, dissolves, cards and sound."""

from __future__ import annotations

import wave
from pathlib import Path

import opentimelineio as otio
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flowsculpt.pipeline.errors import FlowsculptError, MissingInputError, ShotError, UsageError
from flowsculpt.pipeline.plugins.delivery.imported_edit import ImportedEdit
from tests.plugins.delivery.test_timeline import NAME, REEL, exported, seen

FPS = 24


def time(frames: int) -> otio.opentime.RationalTime:
    return otio.opentime.RationalTime(frames, FPS)


def clip(name: str, first: int, count: int) -> otio.schema.Clip:
    return otio.schema.Clip(name, source_range=otio.opentime.TimeRange(time(first), time(count)))


def saved(folder: Path, *parts: otio.core.Composable) -> ImportedEdit:
    """A timeline of one track, written to a file; its edit would lie beside it."""
    timeline = otio.schema.Timeline("Cut")
    timeline.tracks.append(otio.schema.Track("v1", kind=otio.schema.TrackKind.Video))
    timeline.tracks[0].extend(parts)
    otio.adapters.write_to_file(timeline, str(folder / "cut.otio"))
    return ImportedEdit(folder / "cut.otio", ("A010", "A020"), folder)


def test_an_exported_edit_comes_back_with_its_frames_dissolves_cards_and_sound(project, monkeypatch):
    monkeypatch.chdir(project.path)
    with wave.open("shots/tone.wav", "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(48000)
        file.writeframes(bytes(2 * 48000))
    Path("shots/reel.yaml").write_text(REEL + "sound: {file: tone.wav, start: 1, gain: -3}\n")
    before = exported(project, "-o", "cuts/cut.otio")
    assert project.call("film", "--edit", "cuts/cut.otio", "--dry-run").code == 2
    text = ImportedEdit(Path("cuts/cut.otio"), (NAME,), Path("shots")).text()
    Path("shots/cut.yaml").write_text(text)
    assert project.call("film", "--edit", "cuts/cut.otio", "--dry-run").code == 0
    assert project.call("export", "otio", "cut", "-q", "draft", "-o", "cuts/again.otio").code == 0
    after = otio.adapters.read_from_file("cuts/again.otio")
    assert seen(after) == seen(before) and after.duration() == before.duration()
    assert [type(part) for part in after.tracks[0]] == [type(part) for part in before.tracks[0]]
    (first,), (other,) = (
        [part for part in timeline.audio_tracks()[0] if part.metadata] for timeline in (before, after)
    )
    assert first.source_range == other.source_range and other.metadata["flowsculpt"]["gain"] == -3.0


def test_words_over_pictures_come_back_with_their_look(project, monkeypatch):
    monkeypatch.chdir(project.path)
    style = "cards: {ground: picture, size: 1.5, colour: '#ff8000'}\n"
    reel = REEL.replace(", dissolve: 3", "").replace("seconds: 1", "seconds: 0.125")
    reel = reel.replace("  - {card", "  - {card: First, seconds: 0.1}\n  - {card").replace(
        '}\n  - {shot: T010_tiny, frames: "6', ', }\n  - {shot: T010_tiny, dissolve: 2, frames: "6'
    )
    Path("shots/reel.yaml").write_text(reel.replace("title_seconds: 0.5", "title_seconds: 0.25") + style)
    before = exported(project, "-o", "cut.otio")
    assert [track.name for track in before.video_tracks()] == ["pictures", "titles"]
    cut = ImportedEdit(Path("cut.otio"), (NAME,), Path("shots"))
    Path("shots/cut.yaml").write_text(cut.text())
    assert project.call("export", "otio", "cut", "-q", "draft", "-o", "again.otio").code == 0
    after = otio.adapters.read_from_file("again.otio")
    assert seen(after) == seen(before)
    again, once = (
        [
            (c.name, c.range_in_parent(), str(c.media_reference.parameters))
            for c in timeline.video_tracks()[1].find_clips()
        ]
        for timeline in (after, before)
    )
    assert again == once and len(once) == 3


def test_words_within_a_clip_are_refused(tmp_path):
    timeline = otio.schema.Timeline("Cut")
    words = {"title": "Two", "style": {"over": True}}
    card = otio.schema.GeneratorReference("card", "flowsculpt card", None, words)
    span = otio.opentime.TimeRange(time(0), time(12))
    title = otio.schema.Clip("Two", card, span)
    for parts in ([clip("A010", 1, 48)], [otio.schema.Gap(duration=time(6)), title]):
        timeline.tracks.append(otio.schema.Track(kind=otio.schema.TrackKind.Video, children=parts))
    otio.adapters.write_to_file(timeline, str(tmp_path / "cut.otio"))
    with pytest.raises(ShotError, match=r"title Two: its words begin at frame 6 of the film, within a clip"):
        ImportedEdit(tmp_path / "cut.otio", ("A010",), tmp_path).text()


@pytest.mark.slow
@given(
    cuts=st.lists(
        st.tuples(st.sampled_from(["A010", "A020"]), st.integers(1, 500), st.integers(1, 90)), min_size=1
    )
)
def test_any_cut_of_shots_keeps_its_frames(cuts, tmp_path_factory):
    folder = tmp_path_factory.mktemp("cut")
    text = saved(folder, *(clip(*cut) for cut in cuts)).text()
    lines = [line for line in text.splitlines() if "shot:" in line]
    for (name, first, count), line in zip(cuts, lines, strict=True):
        frames = str(first) if count == 1 else f"{first}-{first + count - 1}"
        assert f"shot: {name}" in line and f"frames: {frames}" in line.replace("'", "")


@pytest.mark.parametrize(
    ("parts", "told"),
    [
        ((clip("A011", 1, 5),), "A011 is not a shot"),
        ((clip("A010", 1, 5), otio.schema.Gap(duration=time(12))), "it is a Gap"),
        ((clip("A010", 1, 5), otio.schema.Stack("two")), "it is a Stack"),
        ((), "0 tracks of pictures"),
    ],
)
def test_what_no_edit_can_say_is_told_with_its_place(parts, told, tmp_path):
    with pytest.raises(ShotError, match=told) as refused:
        saved(tmp_path, *parts).text()
    assert "cut.otio: " in str(refused.value)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-be"])
def test_a_timeline_of_another_encoding_is_the_same_edit(encoding, tmp_path):
    edit = saved(tmp_path, clip("A010", 1, 5))
    text = edit.text()
    edit.file.write_bytes(edit.file.read_text(encoding="utf-8").encode(encoding))
    assert ImportedEdit(edit.file, edit.shots, edit.folder).text() == text


def test_an_edit_written_by_hand_is_not_replaced(tmp_path):
    edit = saved(tmp_path, clip("A010", 1, 5))
    edit.target.write_text(edit.text())
    assert edit.text() == edit.target.read_text()
    edit.target.write_text("title: Mine\n")
    with pytest.raises(UsageError, match="was not made from cut"):
        edit.text()


@pytest.mark.parametrize(
    ("content", "kind", "told"),
    [
        (None, MissingInputError, "file not found"),
        ("{", ShotError, "cannot be read"),
        ("[1]", ShotError, "cut|read|holds"),
    ],
)
def test_a_file_that_is_no_timeline_is_told_in_one_line(content, kind, told, tmp_path):
    if content is not None:
        (tmp_path / "a.otio").write_text(content)
    with pytest.raises(FlowsculptError, match=told) as refused:
        ImportedEdit(tmp_path / "a.otio", ("A010",), tmp_path).text()
    assert isinstance(refused.value, kind) and "\n" not in str(refused.value)
