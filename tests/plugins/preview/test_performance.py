"""A performed shot moves as it was seen: a minute of three values, written as keys, and simulated again."""

from __future__ import annotations

import io
import time
import wave
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flowsculpt.pipeline.animation import MeshFrame, animate
from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.flow.regions import TriangleTree
from flowsculpt.pipeline.frames import FrameRange, FrameRate
from flowsculpt.pipeline.mesh import TriangleMesh
from flowsculpt.pipeline.plugins.preview.live_session import READY
from flowsculpt.pipeline.plugins.preview.performance import LiveCurve, Performance
from flowsculpt.pipeline.plugins.preview.performed_takes import TakeFolder, performed
from flowsculpt.pipeline.plugins.preview.performer import SIZES, DisplaySize, Performer
from flowsculpt.pipeline.plugins.preview.settable_values import settable_values
from flowsculpt.pipeline.plugins.preview.shot_editor import ShotEditor, digest_of
from flowsculpt.pipeline.plugins.preview.take_edits import take_edits
from flowsculpt.pipeline.shot import read_shot
from flowsculpt.pipeline.shot.motion import Clock
from tests.plugins.preview.live_follower import Follower
from tests.sounds import RATE, sine, write_sound

EDGE = 0.5

SHOT = f"""\
title: A ball to perform
frames: 1-{{last}}
subject: {{{{solid: icosphere, radius: 1}}}}
resample: {{{{max_edge_length: {EDGE}}}}}
flows:
  - vortex: {{{{axis: z, centre: [0.3, 0.2, 0], radius: 0.7, strength: 0.3}}}}
  - twist: {{{{axis: y, amount: {{{{keys: {{{{1: 0, 12: 5}}}}}}}}}}}}
camera: {{{{azimuth: -30}}}}
"""

STRENGTH = ("flows", 0, "vortex", "strength")
CENTRE = ("flows", 0, "vortex", "centre")
AMOUNT = ("flows", 1, "twist", "amount")
WHERES = (STRENGTH, CENTRE, AMOUNT)


@pytest.fixture
def follower(tmp_path: Path) -> Iterator[Follower]:
    made = Follower(tmp_path, SHOT.format(last=12))
    made.until(READY)
    yield made
    made.session.hold(1e9)


def swing(frame: float) -> dict[Any, tuple[float, ...]]:
    """Return what somebody's hands do at a frame: three values at once."""
    seconds = frame / 24
    return {
        STRENGTH: (0.3 + 0.5 * np.sin(1.9 * seconds) * np.sin(0.3 * seconds),),
        CENTRE: (0.3 + 0.2 * np.sin(1.3 * seconds), 0.2 + 0.2 * np.cos(1.7 * seconds), 0.1 * np.sin(seconds)),
        AMOUNT: (12 * np.sin(2.3 * seconds),),
    }


def distances(points: np.ndarray, mesh: TriangleMesh) -> np.ndarray:
    """Return the distance (N,) of points from a surface."""
    corners = mesh.vertices[mesh.faces]
    face, shares = TriangleTree.of(corners).nearest(points)
    weights = np.column_stack([1.0 - shares.sum(axis=1), shares])
    return np.asarray(np.linalg.norm(np.einsum("nk,nkj->nj", weights, corners[face]) - points, axis=1))


@given(gaps=st.lists(st.floats(0, 3), min_size=3, max_size=40), late=st.floats(0, 2))
def test_values_of_times_that_were_simulated_never_change(gaps: list[float], late: float) -> None:
    clock = Clock(FrameRange(range(1, 200)), FrameRate.of(24))
    curve = LiveCurve(("a",), lambda seconds: (7.0,), lambda frame: frame, clock, 1.0)
    frame, used = 1.0, dict[float, float]()
    for i, gap in enumerate(gaps):
        frame += gap
        curve.add(frame - late, (float(i),))
        while curve.simulated + 1 <= frame:
            start = curve.simulated
            curve.freeze(start + 1)
            for share in (0.0, 0.25, 0.5, 1.0):
                seconds = clock.time(start + share)
                used.setdefault(seconds, curve.at(seconds)[0])
        for seconds, value in used.items():
            assert curve.at(seconds)[0] == pytest.approx(value, abs=1e-6)
    assert curve.count == len(gaps) and set(range(len(gaps))) <= {row[0] for row in curve.rows}


@pytest.mark.slow
def test_a_minute_of_three_values_is_kept_fitted_and_simulated_again_as_it_was_seen(tmp_path: Path) -> None:
    last, rate = 1440, 60
    follower = Follower(tmp_path, SHOT.format(last=24))
    follower.until(READY)
    follower.session.hold(1e9)
    text = SHOT.format(last=last)
    follower.shot.write_text(text)
    drawn = follower.session.drawn(1)
    assert drawn is not None
    follower_request = follower.session.read().request
    performance = Performance(follower.session, with_request(drawn, follower_request), 1, WHERES)
    seen: dict[int, MeshFrame] = {}
    given: dict[Any, list[tuple[float, ...]]] = {where: [] for where in WHERES}
    for i in range(60 * rate - 24):
        frame = 1 + 24 * i / rate + 0.013 * (i % 7)
        for where, row in swing(frame).items():
            performance.curves[where].add(frame, row)
            given[where].append(row)
        performance.advance(1 + 24 * i / rate)
        if performance.frame % 240 == 0 and performance.frame not in seen:
            seen[performance.frame] = performance.meshes()[0]
    seen[performance.frame] = performance.meshes()[0]
    read = settable_values(follower.shot, text)
    edits = []
    for where in WHERES:
        curve = performance.curves[where]
        rows = set(curve.rows)
        assert curve.count == len(given[where]) and all(row in rows for row in given[where])
        taken = performed(where, "test", curve.times, curve.rows, None)
        assert taken.error <= 0.01
        assert len(taken.keys) <= 8 * 60
        edits += take_edits(read, taken)
    ShotEditor(follower.shot).edit(digest_of(text), edits)
    again = {frame.number: frame for frame in animate(read_shot(follower.shot)) if frame.number in seen}
    for number, frame in seen.items():
        apart = distances(frame.mesh.vertices, again[number].mesh)
        assert apart.max() <= 0.1 * EDGE, f"frame {number}"


def test_a_rough_picture_is_as_large_and_shows_the_same(follower: Follower) -> None:
    drawn = follower.session.drawn(2)
    assert drawn is not None
    performance = Performance(follower.session, drawn, 2, [STRENGTH])
    fine, rough = (performance.picture(2.0, (160, 90), is_rough)[0].astype(int) for is_rough in (False, True))
    assert rough.shape == fine.shape == (90, 160, 3)
    apart = np.abs(rough - fine).max(axis=2)
    assert np.median(apart) <= 2 and (apart > 40).mean() < 0.02, "only outlines differ"
    assert (apart > 0).any(), "subsamples are not averaged"


def test_pictures_that_come_late_are_rough_before_they_are_smaller_and_are_fine_again_later() -> None:
    display = DisplaySize()
    seen = []
    for seconds in [1.0] * 40 + [0.0] * 400:
        display.note(seconds, 0.1)
        if SIZES[display.index] not in seen[-1:]:
            seen.append(SIZES[display.index])
    assert seen == [*SIZES, *SIZES[-2::-1]] and SIZES[1] == (SIZES[0][0], True)


def with_request(drawn: Any, request: Any) -> Any:
    """Return a picture of the same frame of a longer shot."""
    return replace(drawn, sketch=replace(drawn.sketch, request=request))


def recorded(performer: Performer, *acts: dict[str, Any], speed: float = 1.0) -> None:
    """Record from frame 2 to the end while something is done."""
    performer.act({"do": "record", "frame": 2, "speed": speed, "whole": False})
    for act in acts:
        time.sleep(0.05)
        performer.act({"do": "play", **act})
    recording = performer.recording
    assert recording is None or recording.done.wait(60)


def value_input(where: tuple[Any, ...], value: Any, age: float = 0.0) -> dict[str, Any]:
    return {"inputs": [[age, "value", list(where), value]]}


def test_what_is_performed_becomes_a_take_and_keys_and_can_be_undone(follower: Follower) -> None:
    editor = ShotEditor(follower.shot)
    performer = Performer(editor, follower.session)
    text = follower.shot.read_text()
    performer.act({"do": "arm", "where": list(STRENGTH)})
    recorded(performer, *(value_input(STRENGTH, 0.3 + 0.1 * i) for i in range(4)))
    assert performer.words.startswith("Take T010_tiny.1: 4 samples, ")
    taken = TakeFolder(follower.shot).read("T010_tiny.1").value_at(STRENGTH)
    assert taken is not None and taken.source == "touch"
    assert {0.3, 0.4, 0.5, 0.6} <= {round(row[0], 6) for row in taken.samples}
    changed = follower.shot.read_text()
    assert changed != text and "camera: {azimuth: -30}" in changed
    editor.undo(editor.state()["digest"])
    assert follower.shot.read_text() == text
    performer.act({"do": "choose", "where": list(STRENGTH), "take": "T010_tiny.1"})
    assert follower.shot.read_text() == changed
    performer.act({"do": "choose", "where": list(STRENGTH), "take": ""})
    assert settable_values(follower.shot, follower.shot.read_text()).curves.get(STRENGTH) is None


def test_a_second_take_of_another_value_leaves_the_first_one_and_each_value_chooses(
    follower: Follower,
) -> None:
    performer = Performer(ShotEditor(follower.shot), follower.session)
    heard = follower.feed.subscribe()
    performer.act({"do": "arm", "where": list(STRENGTH)})
    recorded(performer, value_input(STRENGTH, 1.0))
    follower.until(READY)
    performer.act({"do": "arm", "where": list(AMOUNT)})
    recorded(performer, value_input(STRENGTH, 0.5), value_input(AMOUNT, 9.0))
    follower.until(READY)
    performer.share()
    while not heard.empty():
        if (message := heard.get()).get("event") == "perform":
            state = message
    by_where = {tuple(each["where"]): each for each in state["takes"]}
    strength = by_where[STRENGTH]
    assert [name for name, _ in strength["takes"]] == ["", "T010_tiny.1", "T010_tiny.2"]
    assert strength["chosen"] == "T010_tiny.2"
    assert by_where[AMOUNT]["takes"][1:] == [("T010_tiny.2", "take 2")]
    performer.act({"do": "choose", "where": list(STRENGTH), "take": "T010_tiny.1"})
    read = settable_values(follower.shot, follower.shot.read_text())
    assert read.curves[STRENGTH].at(10 / 24)[0] == pytest.approx(1.0, abs=0.01)
    assert read.curves[AMOUNT].at(10 / 24)[0] == pytest.approx(9.0, abs=0.1)


def test_the_sound_of_the_shot_is_there_from_its_first_frame_on(tmp_path: Path) -> None:
    (tmp_path / "shots").mkdir()
    write_sound(tmp_path / "shots/tone.wav", sine(440.0, 0.25))
    follower = Follower(tmp_path, f"{SHOT.format(last=12)}sound: {{file: tone.wav, start: 0.125}}\n")
    follower.until(READY)
    performer = Performer(ShotEditor(follower.shot), follower.session)
    with wave.open(io.BytesIO(performer.sound())) as heard:
        samples = np.frombuffer(heard.readframes(heard.getnframes()), "<i2").reshape(-1, 2)
        assert heard.getframerate() == RATE and len(samples) == RATE // 2
    assert not samples[: RATE // 8 - 100].any() and np.abs(samples[RATE // 8 :]).max() > 10_000
    follower.session.hold(1e9)


def test_a_recording_ends_whole_when_no_page_is_heard(
    follower: Follower, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("flowsculpt.pipeline.plugins.preview.performer.SILENCE", 0.2)
    performer = Performer(ShotEditor(follower.shot), follower.session)
    performer.act({"do": "arm", "where": list(STRENGTH)})
    recorded(performer, value_input(STRENGTH, 0.7), speed=0.25)
    assert performer.recording is None and performer.words.startswith("Take T010_tiny.1: 1 samples")
    assert sorted(path.name for path in (follower.shot.parent / "takes").iterdir()) == ["T010_tiny.1.json"]


def test_samples_are_on_the_disk_while_the_recording_is_under_way(
    follower: Follower, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("flowsculpt.pipeline.plugins.preview.performer.EACH_KEPT", 0.0)
    performer = Performer(ShotEditor(follower.shot), follower.session)
    performer.act({"do": "arm", "where": list(STRENGTH)})
    performer.act({"do": "record", "frame": 2, "speed": 0.25})
    performer.act({"do": "play", **value_input(STRENGTH, 0.7)})
    takes = follower.shot.parent / "takes"
    while not (kept := list(takes.glob("T010_tiny.recording.*/000001.json"))):
        assert performer.recording is not None
        time.sleep(0.02)
    assert '"samples":[[0.3],[0.7]]' in kept[0].read_text()
    performer.rescue()
    assert not performer.words, "its process is alive"
    performer.act({"do": "stop"})
    assert [path.name for path in takes.iterdir()] == ["T010_tiny.1.json"]


def test_a_take_of_a_shot_that_was_deleted_meanwhile_is_kept(follower: Follower) -> None:
    performer = Performer(ShotEditor(follower.shot), follower.session)
    performer.act({"do": "arm", "where": list(STRENGTH)})
    performer.act({"do": "record", "frame": 2, "speed": 0.25})
    performer.act({"do": "play", **value_input(STRENGTH, 0.7)})
    text = follower.shot.read_text()
    follower.shot.unlink()
    performer.act({"do": "stop"})
    assert performer.words.startswith("Take T010_tiny.1 is kept, and not in the shot: ")
    assert not follower.shot.exists()
    follower.shot.write_text(text)
    performer.act({"do": "choose", "where": list(STRENGTH), "take": "T010_tiny.1"})
    assert "strength: {keys: {" in follower.shot.read_text()


def test_a_second_page_cannot_record_over_the_first_and_hears_so(follower: Follower) -> None:
    performer = Performer(ShotEditor(follower.shot), follower.session)
    with pytest.raises(UsageError, match="nothing is armed"):
        performer.act({"do": "record", "frame": 2})
    performer.act({"do": "arm", "where": list(STRENGTH)})
    performer.act({"do": "record", "frame": 2, "speed": 0.25})
    for asked in ({"do": "record", "frame": 2}, {"do": "arm", "where": list(AMOUNT)}):
        with pytest.raises(UsageError, match="under way, perhaps by another page"):
            performer.act(asked)
    performer.act({"do": "stop"})
    assert performer.words == "Nothing armed was moved; a take needs a movement."


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"do": "dance"}, "do must be one of"),
        ({"do": "arm", "where": ["title"]}, "title is not in this shot"),
        ({"do": "arm", "where": ["flows", 0, "vortex", "axis"]}, "takes no keys"),
        ({"do": "bind", "where": list(STRENGTH)}, "arm the value"),
        ({"do": "record", "frame": "2"}, "has a frame, and a speed"),
        ({"do": "record", "frame": 2, "speed": 3}, "has a frame, and a speed"),
        ({"do": "play", "inputs": [[0, "shout", 1]]}, "'shout' is not a kind of input"),
        ({"do": "play", "inputs": [[0, "midi", "x", 1]]}, "'midi' is not a kind of input"),
        ({"do": "choose", "where": list(STRENGTH), "take": "nobody.1"}, "has no take"),
    ],
)
def test_each_refusal_is_one_message(follower: Follower, asked: dict[str, Any], words: str) -> None:
    performer = Performer(ShotEditor(follower.shot), follower.session)
    with pytest.raises(UsageError, match=words):
        performer.act(asked)


def test_what_does_not_go_by_the_time_of_the_film_cannot_be_armed(follower: Follower) -> None:
    text = follower.shot.read_text().replace(
        "  - twist:", "  - reversed: {flows: [{bend: {amount: 3}}]}\n  - twist:"
    )
    follower.shot.write_text(text)
    performer = Performer(ShotEditor(follower.shot), follower.session)
    where = ["flows", 1, "reversed", "flows", 0, "bend", "amount"]
    with pytest.raises(UsageError, match="does not go by the time of the film"):
        performer.act({"do": "arm", "where": where})
