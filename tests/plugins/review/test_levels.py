"""Levels of the shown frame: waveforms and histograms, of files and of what is seen of layers."""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.plugins.review.page_pictures import SCOPE_COLUMNS, SCOPE_LEVELS, scope_script
from tests.plugins.review.looker import Looker, Opened
from tests.simulated_show import NAME, Desk


def unpacked(script: str) -> tuple[np.ndarray, np.ndarray]:
    data = zlib.decompress(base64.b64decode(json.loads(script.partition(", ")[2].removesuffix(");\n"))))
    size = 4 * SCOPE_LEVELS * SCOPE_COLUMNS
    waves = np.frombuffer(data[:size], np.uint8).reshape(4, SCOPE_LEVELS, SCOPE_COLUMNS)
    return waves, np.frombuffer(data[size:], "<u4").reshape(4, 256)


def test_a_waveform_has_the_levels_of_each_column() -> None:
    """Half a picture of red 200, half of grey 100: in each half all pixels have one level."""
    pixels = np.full((10, 192, 3), 100, np.uint8)
    pixels[:, :96] = (200, 0, 0)
    waves, counts = unpacked(scope_script("a.js", pixels))
    for channel, left in enumerate((round(0.2126 * 200), 200, 0, 0)):
        columns = SCOPE_COLUMNS // 2
        assert (waves[channel, left // 4, :columns] == 255).all()
        assert (waves[channel, 25, columns:] == 255).all()
        assert np.count_nonzero(waves[channel]) == SCOPE_COLUMNS
        assert counts[channel, left] == counts[channel, 100] == 960


def levels(look: Looker) -> Looker:
    look.press("Shift+Z")
    look.wait("review.panels.levels.scopeOf(review.shownSequence, review.transport.frame)")
    return look


def test_the_page_finds_the_same_levels_as_the_command(opened: Opened) -> None:
    look = opened()
    for size in ((9, 37), (12, 240), (7, 501)):
        pixels = np.random.default_rng(1).integers(0, 256, (*size, 4)).astype(np.uint8)
        waves, counts = unpacked(scope_script("a.js", pixels[..., :3]))
        found = look.ask(
            """([data, width, height]) => {
              const { waves, counts } = Scope.of({ data: Uint8ClampedArray.from(data), width, height });
              return [[...waves], [...counts]];
            }""",
            [pixels.ravel().tolist(), size[1], size[0]],
        )
        assert found == [waves.ravel().tolist(), counts.ravel().tolist()]


def test_levels_are_those_of_the_frame_that_is_shown(opened: Opened) -> None:
    """The upper half has the frame's number in eight squares, white for ones; the rest is black."""
    look = levels(opened(frame=3))
    for frame, white in ((3, 2 / 16), (15, 4 / 16), (12, 2 / 16)):
        look.ask(f"review.transport.go({frame})")
        look.wait(f"review.panels.levels.scopeOf(review.a, {frame})")
        told = " ".join(look.tab.inner_text("#panel-levels .legend").split("\n"))
        assert f"white {100 * white:.1f} %" in told and f"black {100 - 100 * white:.1f} %" in told
        assert "1 % of pixels up to 0" in told and "99 % up to 254" in told
    assert look.seen("#panel-levels canvas >> nth=0").max() > 200
    assert look.findings() == []
    look.ask("review.transport.go(17)")
    assert look.tab.inner_text("#panel-levels .note") == "Frame 17 has no picture."
    assert not look.tab.is_visible("#panel-levels canvas >> nth=0")


def test_levels_follow_the_exposure(opened: Opened, layered: Path) -> None:
    look = levels(opened(layered, frame=1))
    look.ask("review.viewing.setLayer('beauty')")
    look.wait("review.viewing.layerOf(review.a, 1, 'beauty') && review.viewing.source(review.a, 1)")
    seen = "review.panels.levels.scopeOf(review.a, 1)"
    before = look.ask(f"{seen}.clipped((step) => step >= WHITE_STEP)")
    look.ask("review.viewing.set({ exposure: -8 })")
    assert look.ask(f"{seen}.clipped((step) => step >= WHITE_STEP)") == 0 < before


def test_levels_of_frames_that_went_are_removed(desk: Desk, page: Callable[..., Path]) -> None:
    folder = desk.page().parent / "scopes"
    kept = {path.name for path in folder.iterdir()}
    (folder / "old.js").write_text("")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(desk.root)
        assert desk.command("review", NAME)[0] == 0
    assert {path.name for path in folder.iterdir()} == kept
