"""Values of a shot follow a sound: what they are, what is heard, and what is refused."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.errors import ShotError
from flowsculpt.pipeline.production.request.manifest import mesh_keys
from flowsculpt.pipeline.shot import read_shot
from flowsculpt.pipeline.shot.shot import Shot
from tests.needed_plugins import needs_plugins
from tests.sounds import RATE, sine, times, write_sound

HEAD = "title: S\nframes: 1-25\nsubject: {solid: box}\n"
SHOT = f"""{HEAD}\
resample:
  max_edge_length: {{audio: a.wav, base: 0.5, gain: -0.2}}
  hard_angle: {{audio: a.wav, base: 30, gain: 9}}
flows:
  - twist: {{amount: {{audio: a.wav, band: bass, gain: 60, base: 5, attack: 0, release: 0}}}}
  - vortex: {{centre: {{audio: a.wav, gain: [0, 2, 0]}}, strength: 2}}
  - formula: {{velocity: [k, 0, 0], with: {{k: {{audio: a.wav, band: [900, 1100]}}}}}}
camera: {{azimuth: {{audio: a.wav, start: 0.5}}, margin: {{audio: a.wav, gain: 0.2}}}}
"""


@pytest.fixture(scope="module")
def tones(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Half a second of silence, then 100 Hz and 1 kHz, then silence: one second in all."""
    folder = tmp_path_factory.mktemp("tones")
    heard = (times(1) >= 0.5) & (times(1) < 0.75)
    write_sound(folder / "a.wav", np.where(heard, sine(100, 1, 0.4) + sine(1000, 1, 0.2), 0.0))
    return folder


def written(folder: Path, text: str = SHOT) -> Path:
    path = folder / "a.yaml"
    path.write_text(text)
    return path


def shot_of(folder: Path, **values: str) -> Shot:
    """Read a shot with a twist whose amount has these entries, in place of others."""
    entries = {"audio": "a.wav", "gain": "60", **values}
    amount = ", ".join(f"{name}: {value}" for name, value in entries.items() if value)
    flow = f"resample: off\nflows: [{{twist: {{amount: {{{amount}}}}}}}]\n"
    return read_shot(written(folder, HEAD + flow))


@needs_plugins("fields")
def test_everything_that_may_be_keyed_may_follow_a_sound_and_is_drawn(tones: Path) -> None:
    from flowsculpt.pipeline.plugins.review.keyed_curves import curves_of

    curves = {curve.name: curve for curve in curves_of(written(tones))}
    assert {name: curve.unit for name, curve in curves.items()} == {
        "resample.max_edge_length": "units",
        "resample.hard_angle": "degrees",
        "flows.0.twist.amount": "degrees/unit",
        "flows.1.vortex.centre": "units",
        "flows.2.formula.with.k": "",
        "camera.azimuth": "degrees",
        "camera.margin": "",
    }
    amount = curves["flows.0.twist.amount"]
    assert amount.values[amount.frames == 5] == pytest.approx(5.0)
    assert amount.values[amount.frames == 16] == pytest.approx(65.0, rel=1e-3)  # 0.625 s
    assert amount.values[amount.frames == 24] == pytest.approx(5.0)
    centre = curves["flows.1.vortex.centre"].values
    assert centre.shape[1] == 3 and centre[:, 1].max() > 1.9 and not centre[:, ::2].any()
    azimuth = curves["camera.azimuth"]
    assert azimuth.values[azimuth.frames <= 24].max() < 0.01  # it begins half a second later


def test_the_key_belongs_to_the_content_of_the_sound(tones: Path, tmp_path: Path) -> None:
    before = mesh_keys(shot_of(tones).motion)
    shutil.copy(tones / "a.wav", tmp_path / "another name.wav")
    assert mesh_keys(shot_of(tmp_path, audio="another name.wav").motion) == before
    write_sound(tmp_path / "a.wav", np.where(times(1) < 0.7, 0.0, sine(100, 1)))
    other = mesh_keys(shot_of(tmp_path).motion)
    same = [number for number in before if before[number] == other[number]]
    assert same == list(range(1, same[-1] + 1)) and 11 <= same[-1] <= 13  # up to the change, at 0.5 s


def test_a_shot_reads_the_sound_with_its_digest(tones: Path) -> None:
    shot = shot_of(tones)
    assert [path.name for path, _ in shot.files] == ["a.wav"]


@needs_plugins("fields")
def test_sounds_that_values_follow_are_heard_once_unless_the_shot_says_otherwise(tones: Path) -> None:
    (track,) = read_shot(written(tones)).sounds
    assert (track.file.name, track.start, track.gain) == ("a.wav", 0.0, 0.0)
    assert read_shot(written(tones, SHOT + "sound: off\n")).sounds == ()
    (own,) = read_shot(written(tones, SHOT + "sound: {file: a.wav, start: -0.25, fade_out: 0.5}\n")).sounds
    assert (own.start, own.fade_out) == (-0.25, 0.5)
    (alone,) = read_shot(written(tones, HEAD + "resample: off\nsound: {file: a.wav}\n")).sounds
    assert alone == replace(own, start=0.0, fade_out=0.0)


def test_a_sound_that_ends_early_or_is_silent_is_noted(tones: Path) -> None:
    assert not shot_of(tones, band="bass").notes
    (early,) = shot_of(tones, start="-0.25").notes
    assert "a.wav ends at 0.75 s, and the shot at 1 s; from there on its level is 0" in early
    write_sound(tones / "low.wav", sine(100, 2) * np.hanning(2 * RATE))
    (silent,) = shot_of(tones, audio="low.wav", band="high").notes
    assert "low.wav is silent from 4000 to 20000 Hz" in silent


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ({"audio": "b.wav"}, "file b.wav is not there; it is looked for beside the shot file"),
        ({"audio": "c.wav"}, r"c.wav: cannot be read as sound \(.*\); save it as WAV or FLAC"),
        (
            {"band": "[250, 20]"},
            "a band is .from, to. in Hz, 10 Hz wide or more. Write .20, 250.",
        ),
        (
            {"band": "[100, 105]"},
            "a band is .from, to. in Hz, 10 Hz wide or more. Write .90, 115.",
        ),
        ({"band": "[100]"}, "is not a band; a band is .from, to. in Hz"),
        ({"band": "[30000, 40000]"}, "has nothing above 24000 Hz, and the band begins at 30000 Hz"),
        ({"band": "low"}, "'low' is not a band"),
        ({"attack": "-1"}, "attack: -1 is out of range; it must be at least 0"),
        ({"normalise": "rms"}, "'rms' is not a normalisation"),
        ({"gain": "[1, 2, 3]"}, "gain"),
        ({"volume": "3"}, "volume: unknown name"),
        ({"attack": "5ms"}, "5ms has a unit; it is a number of seconds. Write 0.005."),
        ({"offset": "3"}, "offset: unknown name. Did you mean 'base'"),
        ({"audio": "", "sound": "a.wav"}, "a value that follows a sound has audio. Write {audio: a.wav}."),
    ],
)
def test_a_mistake_is_told_with_place_rule_and_remedy(
    entries: dict[str, str], message: str, tones: Path
) -> None:
    (tones / "c.wav").write_bytes(b"no sound")
    with pytest.raises(ShotError, match=message) as told:
        shot_of(tones, **entries)
    assert str(told.value).startswith(f"{tones}/a.yaml:5:")
    assert len(str(told.value).splitlines()) == 1


def test_a_value_out_of_its_bounds_between_half_frames_is_refused(tones: Path) -> None:
    text = "camera: {field_of_view: {audio: a.wav, base: 20, gain: -30, attack: 0, release: 0}}\n"
    with pytest.raises(ShotError, match=r"field_of_view: -\d.* it must stay above 0 and below 180"):
        read_shot(written(tones, SHOT.split("camera")[0] + text))


def test_flows_follow_no_sound_while_speed_re_times_them(tones: Path) -> None:
    with pytest.raises(ShotError, match=r"flows.0.twist.amount follows a sound, and speed re-times the flow"):
        read_shot(written(tones, SHOT + "speed: 0.5\n"))
    alone = SHOT.split("flows")[0] + "flows: [{twist: {amount: 30}}]\nspeed: {audio: a.wav, gain: 2}\n"
    shot = read_shot(written(tones, alone))
    assert shot.motion.clock.flow_time(10) == 0.0 < shot.motion.clock.flow_time(25)
