"""Stills as JPEG with a gain map: a picture for any screen, and HDR for those that can show it."""

from __future__ import annotations

import sys
from pathlib import Path

import imagecodecs
import numpy as np
import pytest
from PIL import Image

from flowsculpt.pipeline.errors import MachineError, UsageError
from flowsculpt.pipeline.plugins.delivery.gain_map import require_gain_maps, write_gain_map
from flowsculpt.render.post.hdr import BT2020, pq_of_nits
from tests.conftest import QUALITY

NAME = "T010_tiny"


def card(colour: tuple[float, float, float], nits: float) -> np.ndarray:
    """A frame (64, 96, 3) of one colour, linear Rec.709, in PQ."""
    light = nits * np.maximum(BT2020.from_rec709(np.array(colour)), 0.0)
    return np.broadcast_to(np.rint(65535.0 * pq_of_nits(light)).astype(np.uint16), (64, 96, 3))


@pytest.mark.parametrize("nits", [20.0, 100.0, 203.0, 800.0, 1000.0])
def test_a_grey_card_comes_back_with_its_nits(tmp_path: Path, nits: float):
    write_gain_map(tmp_path / "card.jpg", iter([card((1.0, 1.0, 1.0), nits)]))
    shown = imagecodecs.ultrahdr_decode((tmp_path / "card.jpg").read_bytes())[32, 48, :3]
    np.testing.assert_allclose(203.0 * shown.astype(float), nits, rtol=0.015)


def test_programs_without_hdr_see_a_jpeg_in_display_p3_and_the_map_follows_the_standard(tmp_path: Path):
    path = tmp_path / "card.jpg"
    write_gain_map(path, iter([card((1.0, 0.2, 0.1), 150.0)]))
    content = path.read_bytes()
    assert b"urn:iso:std:iso:ts:21496:-1" in content
    with Image.open(path) as picture:
        assert picture.size == (96, 64)
        assert b"P3" in picture.info["icc_profile"] or b"P\x003" in picture.info["icc_profile"]
        red, green, blue = np.asarray(picture)[32, 48]
    assert red > 150 > green > blue


def test_the_same_frame_gives_the_same_bytes(tmp_path: Path):
    noise = np.random.default_rng(2).integers(0, 49000, (64, 96, 3)).astype(np.uint16)
    for name in ("a", "b"):
        write_gain_map(tmp_path / name, iter([noise]))
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_several_frames_or_a_missing_library_are_refused(monkeypatch: pytest.MonkeyPatch):
    with pytest.raises(UsageError, match="gain-map holds one frame, not 2; choose one with -f 40"):
        require_gain_maps(2)
    monkeypatch.setitem(sys.modules, "imagecodecs", None)
    with pytest.raises(MachineError, match=r"gain-map needs the package imagecodecs .* extra \[gain-maps\]"):
        require_gain_maps(1)


def test_a_finished_frame_is_delivered_with_a_gain_map_and_a_range_is_refused(finished, monkeypatch):
    monkeypatch.chdir(finished.path)
    done = finished.call("deliver", NAME, "-q", QUALITY, "-f", "3", "--as", "gain-map")
    assert done.code == 0, done.err
    path = finished.path / "renders" / NAME / QUALITY / "deliver" / f"{NAME}.3.gain-map.jpg"
    with Image.open(path) as picture:
        assert np.asarray(picture).std() > 5
    refused = finished.call("deliver", NAME, "-q", QUALITY, "-f", "2-3", "--as", "gain-map")
    assert refused.code == 2
    assert "gain-map holds one frame, not 2" in refused.err
    slated = finished.call("deliver", NAME, "-q", QUALITY, "-f", "3", "--as", "gain-map", "--slate", "apart")
    assert slated.code == 2 and "leave out --slate" in slated.err


def test_a_poster_is_one_frame_as_png_and_a_range_is_refused(finished, monkeypatch):
    monkeypatch.chdir(finished.path)
    edit = f"title: A\nshots: [{{shot: {NAME}, frames: 3-3}}]\ntitle_seconds: 0.04\ncredits_seconds: 0\n"
    edit += "cards: {ground: picture, colour: '#000000'}\n"
    pictures = []
    for name, text in (("poster", edit), ("bare", edit.replace("0.04", "0"))):
        (finished.path / "shots" / f"{name}.yaml").write_text(text, encoding="utf-8")
        done = finished.call("deliver", name, "-q", QUALITY, "--as", "png")
        assert done.code == 0, done.err
        with Image.open(finished.path / "renders" / "film" / QUALITY / "deliver" / f"{name}.png") as picture:
            pictures.append(np.asarray(picture.convert("RGB")).astype(int))
    title, bare = pictures
    assert bare.std() > 5 and 0.001 < np.mean(np.abs(title - bare).max(axis=2) > 20) < 0.3
    refused = finished.call("deliver", NAME, "-q", QUALITY, "-f", "2-3", "--as", "png")
    assert refused.code == 2 and "png holds one frame, not 2; choose one with -f 40" in refused.err
