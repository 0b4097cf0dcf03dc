"""A sound is heard at the times that its file gives: after the pictures began, and with its pauses."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from flowsculpt.pipeline.flow.keyframes import Envelope
from flowsculpt.pipeline.production.request.audio import AudioTrack
from flowsculpt.render.base.input_files import InputFile
from flowsculpt.render.base.serialise import to_plain
from flowsculpt.render.movie.band_level import band_level
from flowsculpt.render.movie.movie_sound import RATE, Sound, blocks, require_sound, silence_in
from tests.sounds import sine, write_sound

BLOCK, BLOCKS = 960, 50  # samples that every encoder here takes; one second in all


def write_clip(path: Path, codec: str, start: float = 0.0, pause: range = range(0)) -> Path:
    """Write a second of pictures, and of a tone from `start` on; blocks in `pause` are left out."""
    form = "s16" if codec == "pcm_s16le" else "u8" if codec == "pcm_u8" else "flt"
    tone = np.where(np.arange(BLOCK) // 8 % 2, 0.5, -0.5)
    kinds = {
        "s16": (tone * 2**15).astype("<i2"),
        "u8": (128 + tone * 64).astype("u1"),
        "flt": tone.astype("f4"),
    }
    with av.open(str(path), "w") as container:
        pictures = container.add_stream("mpeg4", rate=24)
        pictures.width = pictures.height = 64
        pictures.pix_fmt = "yuv420p"
        sound = container.add_stream(codec, rate=RATE, layout="mono")
        for number in range(24):
            picture = av.VideoFrame(64, 64, "yuv420p")
            picture.pts, picture.time_base = number, Fraction(1, 24)
            container.mux(pictures.encode(picture))
        container.mux(pictures.encode(None))
        for number in (number for number in range(BLOCKS) if number not in pause):
            frame = av.AudioFrame.from_ndarray(kinds[form][None], format=form, layout="mono")
            frame.sample_rate, frame.time_base = RATE, Fraction(1, RATE)
            frame.pts = round(start * RATE) + BLOCK * number
            container.mux(sound.encode(frame))
        container.mux(sound.encode(None))
    return path


def heard(path: Path) -> tuple[float, float]:
    """Return when a sound is first and last heard, in seconds."""
    samples = np.concatenate(list(blocks(Sound(path), Fraction(2))), axis=1)[0]
    loud = np.flatnonzero(np.abs(samples) > 0.1)
    return loud[0] / RATE, loud[-1] / RATE


@pytest.mark.parametrize(
    ("name", "codec"),
    [
        ("a.mkv", "pcm_s16le"),
        ("b.mkv", "pcm_u8"),
        ("c.mov", "pcm_s16le"),
        ("d.mkv", "libopus"),
        ("e.ts", "aac"),
    ],
)
@pytest.mark.parametrize("start", [0.0, 0.5])
def test_a_sound_begins_where_its_file_has_it_beside_the_pictures(
    name: str, codec: str, start: float, tmp_path: Path
) -> None:
    path = write_clip(tmp_path / name, codec, start)
    near = 0.022 if codec == "aac" else 0.003  # its encoder begins with a block of silence
    assert heard(path)[0] == pytest.approx(start, abs=near)
    assert silence_in(path) == pytest.approx(start, abs=near)
    level = band_level(path, InputFile(path).digest(), 20.0, 24000.0)
    assert (level.seconds, level.silence) == (pytest.approx(require_sound(path)), silence_in(path))
    if start:
        assert level.levels[round(0.4 / level.interval)] < 1e-3 < level.levels[round(0.8 / level.interval)]


def test_a_pause_in_the_timestamps_is_silent_and_what_follows_is_in_step(tmp_path: Path) -> None:
    path = write_clip(tmp_path / "a.mkv", "pcm_s16le", pause=range(10, 30))
    assert heard(path)[1] == pytest.approx(1.0, abs=0.003)
    assert silence_in(path) == pytest.approx(0.4, abs=0.002)


def test_the_key_of_a_sound_has_its_silence_only_where_it_has_some(tmp_path: Path) -> None:
    plain = write_sound(tmp_path / "a.wav", sine(400, 0.5))
    assert silence_in(plain) == 0.0
    for silence, is_in_key in ((0.0, False), (0.5, True)):
        track = AudioTrack(str(plain), "", silence=silence)
        envelope = Envelope("", (20.0, 250.0), 0.0, 0.0, "loudest", 0.005, (1.0,), silence)
        assert ("silence" in track.content) is is_in_key
        assert ("silence" in to_plain(envelope)) is is_in_key
