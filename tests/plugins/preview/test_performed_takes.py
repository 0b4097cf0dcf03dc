"""Takes are kept whole, and their keys change a shot file by those keys alone."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.errors import FlowsculptError, ShotError, UsageError
from flowsculpt.pipeline.plugins.preview.performed_takes import (
    PerformedValue,
    Recorded,
    RecordedValue,
    Take,
    TakeFolder,
    TakeJournal,
    performed,
)
from flowsculpt.pipeline.plugins.preview.settable_values import settable_values
from flowsculpt.pipeline.plugins.preview.shot_editor import ShotEditor, digest_of
from flowsculpt.pipeline.plugins.preview.take_edits import is_chosen, restoring_edits, take_edits

SHOT = """\
# A cube, performed
title: 'A cube'   # as on the slate
frames: 1-96
subject: {solid: box, size: [2, 2, 2]}
resample: {max_edge_length: 0.3}
flows:   # first the stir
  - vortex: {strength: {keys: {3: 0, 0.5s: 3, 30: {value: 7, ease: sine_in}, 60: 2, 90: 1}, ease: bezier}} # l
  - twist:
      axis: y  # upright
      amount:
        keys:
          1: 0    # calm
          40: 30
          96: 80  # wild
  - translation: {rate: {formula: [0.1*t, 0, 0]}}
  - rotation: {speed: {ease: linear, keys: {1: 0, 13: 20}, after: ping_pong}}
  - scaling: {rate: [0, 0, 0]}
camera: {azimuth: -24} # around
"""

STRENGTH = ("flows", 0, "vortex", "strength")
AMOUNT = ("flows", 1, "twist", "amount")
RATE = ("flows", 2, "translation", "rate")
SPEED = ("flows", 3, "rotation", "speed")


@pytest.fixture
def shot(tmp_path: Path) -> Path:
    path = tmp_path / "A010_cube.yaml"
    path.write_text(SHOT)
    return path


def curve_of(path: Path, text: str, where: tuple[str | int, ...], frames: np.ndarray) -> np.ndarray:
    read = settable_values(path, text)
    return np.array([read.curves[where].at(read.clock.time(float(frame))) for frame in frames])


def take_of(
    path: Path, where: tuple[str | int, ...], first: float, last: float, to: float = 5.0
) -> PerformedValue:
    """Return a take that begins at the value of the file, as recording does, and swings to another one."""
    times = np.linspace(first, last, 60)
    text = path.read_text()
    read = settable_values(path, text)
    value = next(each for each in read.values if each.where == where)
    if where in read.curves:
        start = np.array(read.curves[where].at(read.clock.time(float(first))))
    else:
        start = np.atleast_1d(np.array(value.value, float))
    share = np.linspace(0, 1, 60)[:, None]
    rows = start + share * (to - start) + 0.4 * np.sin(9 * share) * share
    return performed(where, "pointer", times.tolist(), rows.tolist(), value.value)


def written(path: Path, *edits: object) -> str:
    editor = ShotEditor(path)
    editor.edit(digest_of(path.read_text()), edits)  # type: ignore[arg-type]
    return path.read_text()


def chosen(path: Path, taken: PerformedValue) -> str:
    return written(path, *take_edits(settable_values(path, path.read_text()), taken))


@settings(max_examples=12, deadline=None)
@given(first=st.floats(1, 80), length=st.floats(3, 60), where=st.sampled_from([STRENGTH, AMOUNT]))
def test_outside_of_a_take_the_curve_stays_and_within_it_is_performed(
    tmp_path_factory: pytest.TempPathFactory, first: float, length: float, where: tuple[str | int, ...]
) -> None:
    path = tmp_path_factory.mktemp("merge") / "A010_cube.yaml"
    path.write_text(re.sub("    # calm|  # wild", "", SHOT))
    last = min(96.0, first + length)
    taken = take_of(path, where, first, last)
    frames = np.linspace(1, 96, 381)
    before = curve_of(path, SHOT, where, frames)
    after = curve_of(path, chosen(path, taken), where, frames)
    last_key = 90 if where == STRENGTH else 96
    outside = (frames < first - 0.01) | ((frames > np.floor(last) + 1.01) & (last < last_key))
    reach = np.ptp(before)
    assert np.abs(after - before)[outside].max(initial=0.0) < 0.002 * reach
    rows = np.interp(frames, taken.times, np.array(taken.samples)[:, 0])
    inside = (frames >= first) & (frames <= last)
    assert np.abs(after[:, 0] - rows)[inside].max() <= 0.0101 * np.ptp(taken.samples)


def test_a_take_changes_its_keys_and_no_other_character(shot: Path) -> None:
    text = chosen(shot, take_of(shot, STRENGTH, 35, 50))
    before, after = SHOT.splitlines(), text.splitlines()
    assert [i for i, (a, b) in enumerate(zip(before, after, strict=True)) if a != b] == [6]
    kept = "  - vortex: {strength: {keys: {3: 0, 0.5s: 3, 30: {"
    assert after[6].startswith(kept) and after[6].endswith(", 90: 1}, ease: bezier}} # l")
    assert re.search(r" 35: \{value: [-\d.]+, right: \[.+, left: \[", after[6])


def test_comments_at_keys_that_stay_stay_too(shot: Path) -> None:
    text = chosen(shot, take_of(shot, AMOUNT, 50, 70))
    assert "          1: 0    # calm\n          40: {" in text and "# wild" in text
    assert text.split("amount:")[0] == SHOT.split("amount:")[0]


def test_comments_between_keys_that_would_go_refuse_the_take(shot: Path) -> None:
    with pytest.raises(ShotError, match=r"has comments between the keys that would go\. Edit it"):
        chosen(shot, take_of(shot, AMOUNT, 1, 50))
    assert shot.read_text() == SHOT


def test_a_constant_gets_the_keys_and_a_formula_is_kept_outside(shot: Path) -> None:
    azimuth = take_of(shot, ("camera", "azimuth"), 10, 30, 20.0)
    text = chosen(shot, azimuth)
    assert re.search(r"camera: \{azimuth: \{keys: \{10: \{value: -24, right: \[", text)
    assert text.split("camera:")[0] == SHOT.split("camera:")[0]
    times = np.linspace(20, 40, 50)
    rows = np.stack([np.interp(times, [20, 40], [0.079, 2]), 0 * times, 0 * times], axis=1)
    frames = np.array([1.0, 10, 19, 42, 60, 96])
    before = curve_of(shot, SHOT, RATE, frames)
    taken = performed(RATE, "pen", times.tolist(), rows.tolist(), None)
    assert curve_of(shot, chosen(shot, taken), RATE, frames) == pytest.approx(before, abs=1e-3)


def test_keys_that_repeat_are_kept_outside_of_a_take(shot: Path) -> None:
    frames = np.array([1.0, 7, 13, 19, 25, 29, 43, 49, 60, 96])
    before = curve_of(shot, SHOT, SPEED, frames)
    after = curve_of(shot, chosen(shot, take_of(shot, SPEED, 30, 41)), SPEED, frames)
    assert after == pytest.approx(before, abs=0.1)


def test_what_a_value_had_before_comes_back(shot: Path) -> None:
    folder = TakeFolder(shot)
    for where in (STRENGTH, ("camera", "azimuth")):
        taken = take_of(shot, where, 20, 40)
        name = folder.save(Take(shot="A010_cube", fps=24, speed=1, values=[taken]))
        chosen(shot, taken)
        read = settable_values(shot, shot.read_text())
        assert is_chosen(next(v for v in read.values if v.where == where), taken)
        again = folder.read(name).values[0]
        written(shot, *restoring_edits(read, again))
        frames = np.linspace(1, 96, 50)
        if where == STRENGTH:
            now = curve_of(shot, shot.read_text(), where, frames)
            assert now == pytest.approx(curve_of(shot, SHOT, where, frames))
    assert "camera: {azimuth: -24} # around" in shot.read_text()


def test_a_value_that_the_shot_does_not_have_any_more_is_one_message(shot: Path) -> None:
    taken = take_of(shot, STRENGTH, 20, 40)
    shot.write_text(SHOT.replace("vortex", "vortex_pair"))
    with pytest.raises(UsageError, match=r"flows\.0\.vortex\.strength is not in this shot"):
        take_edits(settable_values(shot, shot.read_text()), taken)


def test_takes_of_two_pages_get_names_of_their_own_and_those_of_a_renamed_shot_are_found(shot: Path) -> None:
    taken = take_of(shot, STRENGTH, 20, 40)
    take = Take(shot="A010_cube", fps=24, speed=0.5, values=[taken])
    folders = TakeFolder(shot), TakeFolder(shot)
    assert [folder.save(take) for folder in folders] == ["A010_cube.1", "A010_cube.2"]
    renamed = shot.rename(shot.with_name("A020_block.yaml"))
    folder = TakeFolder(renamed)
    assert folder.names() == ["A010_cube.1", "A010_cube.2"]
    assert folder.save(take) == "A020_block.1"
    shot.write_text(SHOT)
    assert folder.names() == ["A020_block.1"], "another shot has that name again"


@pytest.mark.parametrize(
    "content",
    ["", "[]", "{", '{"version": 2}', '{"version": 1, "shot": "a", "fps": NaN}', "\x00\xff" * 100],
)
def test_a_damaged_take_is_one_message_and_hides_no_other(shot: Path, content: str) -> None:
    folder = TakeFolder(shot)
    name = folder.save(Take(shot="A010_cube", fps=24, speed=1, values=[take_of(shot, STRENGTH, 20, 40)]))
    (folder.path / "A010_cube.2.json").write_text(content)
    with pytest.raises(FlowsculptError, match=r"A010_cube\.2\.json: .*"):
        folder.read("A010_cube.2")
    assert list(folder.all({})) == [name]
    with pytest.raises(UsageError, match="is not the name of a take"):
        folder.read("../A010_cube")


def test_times_and_samples_of_a_take_must_agree(shot: Path) -> None:
    folder = TakeFolder(shot)
    name = folder.save(Take(shot="A010_cube", fps=24, speed=1, values=[take_of(shot, STRENGTH, 20, 40)]))
    path = folder.path / f"{name}.json"
    data = json.loads(path.read_text())
    for change in ({"times": [3, 2]}, {"samples": [[1]]}, {"samples": [[1, 2], [3, 4]]}):
        values = [{**data["values"][0], **change}]
        path.write_text(json.dumps({**data, "values": values}))
        with pytest.raises(UsageError, match=r"values\.0"):
            folder.read(name)


def test_what_a_killed_process_has_recorded_is_saved_as_a_take_at_the_next_start(tmp_path: Path) -> None:
    shot = tmp_path / "A.yaml"
    script = f"""
import os, signal
from pathlib import Path
from flowsculpt.pipeline.plugins.preview.performed_takes import Recorded, RecordedValue, TakeJournal
journal = TakeJournal(Path({str(shot)!r}))
for second in range(3):
    times = [24.0 * second + i for i in range(24)]
    moved = RecordedValue(where=["a"], source="touch", times=times, samples=[[t] for t in times], before=2)
    still = RecordedValue(where=["b"], source="touch", times=[], samples=[])
    journal.keep(Recorded(shot="A", fps=24, speed=0.5, whole=True, values=[moved, still]))
os.kill(os.getpid(), signal.SIGKILL)
"""
    killed = subprocess.run([sys.executable, "-c", script], check=False)
    assert killed.returncode == -signal.SIGKILL
    folder = TakeFolder(shot)
    under_way = TakeJournal(shot)
    mine = RecordedValue(where=["a"], source="touch", times=[1.0], samples=[[1.0]])
    under_way.keep(Recorded(shot="A", fps=24, speed=1, whole=True, values=[mine]))
    assert folder.rescue() == ["A.1"] and folder.rescue() == []
    take = folder.read("A.1")
    value = take.value_at(["a"])
    assert value is not None and take.speed == 0.5 and take.value_at(["b"]) is None
    assert value.times == list(range(72)) and value.before == 2 and len(value.keys) == 2
    assert len(list((tmp_path / "takes").iterdir())) == 2, "what this process records stays"
    under_way.end()
    assert [path.name for path in (tmp_path / "takes").iterdir()] == ["A.1.json"]


def test_of_a_damaged_recording_all_before_the_damage_is_saved(tmp_path: Path) -> None:
    folder = tmp_path / "takes/A.recording.nobody"
    folder.mkdir(parents=True)
    value = RecordedValue(where=["a"], source="touch", times=[1.0, 2.0], samples=[[0.0], [3.0]])
    text = Recorded(shot="A", fps=24, speed=1, whole=False, values=[value]).model_dump_json()
    (folder / "000001.json").write_text(text)
    (folder / "000002.json").write_text(text[:40])
    strange = folder.with_name("A.recording.stranger")
    strange.mkdir()
    for number, time in enumerate((5.0, 1.0)):  # times that go back
        other = value.model_copy(update={"times": [time, time + 1]})
        second = Recorded(shot="A", fps=24, speed=1, whole=False, values=[other])
        (strange / f"{number}.json").write_text(second.model_dump_json())
    assert TakeFolder(tmp_path / "A.yaml").rescue() == ["A.1"]
    assert strange.is_dir() and not folder.exists(), "what makes no take is not thrown away"
