"""Layers on the page: values as they were rendered, shown, probed and saved."""

from __future__ import annotations

import base64
import json
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flowsculpt.pipeline.plugins.review.page_pictures import LayerWriter, as_script
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.picture_sequences import PictureSequence
from flowsculpt.render.post.colour import to_display
from flowsculpt.render.post.hdr import nits_of_pq
from flowsculpt.render.post.image import read_exr, read_png, write_exr
from flowsculpt.render.scene.aovs import RenderedFrame
from tests.plugins.review.looker import Looker, Opened
from tests.simulated_show import NAME, Desk


def test_layers_are_the_finished_light_and_the_aovs_of_the_frame_it_was_made_from(tmp_path: Path) -> None:
    def written(name: str, header: dict[str, str], **arrays: np.ndarray) -> Path:
        write_exr(tmp_path / f"{name}.exr", RenderedFrame(arrays, {}), header)
        return tmp_path / f"{name}.exr"

    clean, noisy = np.full((4, 6, 3), 0.5, np.float32), np.full((4, 6, 3), 0.25, np.float32)
    depth = np.full((4, 6), 3.0, np.float32)
    finished = written("frame", {"key": "f" * 32, "raw_key": "a" * 32}, beauty=clean)
    raws = {
        1: written("raw", {"key": "a" * 32}, beauty=noisy, depth=depth),
        2: written("another", {"key": "b" * 32}, beauty=noisy, depth=depth),
    }
    known: dict[str, Any] = {"shot": NAME, "kind": "render", "label": "draft", "quality": "draft"}
    sequence = PictureSequence(
        **known, subject=NAME, numbers=(1, 2), files={}, faults={}, seconds={}, raws=raws
    )
    (tmp_path / "layers").mkdir()
    store = Project(tmp_path, 1).store
    for number, names in (
        (1, ["picture", "beauty", "depth", "nits", "view"]),
        (2, ["picture", "beauty", "nits", "view"]),
    ):
        one = replace(sequence, files={number: finished})
        layers = LayerWriter(store, tmp_path / "layers", 1, 1).write(one, lambda: None)[number]
        assert list(layers) == names
        script = (tmp_path / "layers" / layers["beauty"]).read_text()
        data = json.loads(script.partition(", ")[2].removesuffix(");\n"))
        steps = list(zlib.decompress(base64.b64decode(data["data"])))
        bits = steps[0] + 256 * steps[len(steps) // 2]
        assert bits == np.float16(0.5).view(np.uint16), "the finished beauty"


def wait_for_layers(look: Looker) -> None:
    look.wait(
        "review.viewing.names.length && [...review.viewing.layers.entries.values()].every((l) => l !== null)"
    )


def test_linear_values_are_those_of_the_rendered_frame(opened: Opened, desk: Desk, layered: Path) -> None:
    look = opened(layered, frame=1)
    look.press("Shift+P", "Shift+V")
    look.wait("review.viewing.layerOf(review.a, 1, 'beauty')")
    request = desk.request("draft")
    beauty = read_exr(desk.root / request.place("frame", 1))[0]["beauty"]
    for x, y in ((20, 30), (200, 200), (479, 269)):
        values = look.ask(f"review.viewing.layerOf(review.a, 1, 'beauty').at({x}, {y})")
        assert values == pytest.approx(beauty[y, x].astype(np.float16).tolist())
    assert look.ask("[1.5, 6e-8, -65504, NaN].map((v) => v)") is not None
    halves = np.array([1.5, 6e-8, -65504.0, np.inf, 0.1], np.float16)
    assert look.ask("(bits) => bits.map(fromHalf)", halves.view(np.uint16).tolist()) == halves.tolist()
    box = look.tab.locator("#stage").bounding_box()
    assert box is not None
    place = look.ask("review.stage.places()[0]")
    x, y = (100.5 / 480 * place["width"], 200.5 / 270 * place["height"])
    look.tab.mouse.move(box["x"] + place["x"] + x, box["y"] + place["y"] + y)
    look.wait("review.viewing.layerOf(review.a, 1, 'nits') && !id('probe').innerText.includes('no layers')")
    words = look.tab.inner_text("#probe").split()
    exposure = request.shot.picture.lights.exposure
    nits = nits_of_pq(to_display(beauty, exposure, "pq"))[200, 100]
    side, *shown = words[words.index("nits") + 1 :][:4]
    assert (side, [float(word) for word in shown]) == ("A", pytest.approx(nits.tolist(), rel=2e-3, abs=0.06))
    assert words[:3] == ["Pixel", "100,", "200"] and f"{beauty[200, 100, 0]:.4f}" in words


def graded(
    values: np.ndarray, kind: str, exposure: float, gamma: float, channel: str, clipping: bool
) -> np.ndarray:
    """Return what is to be seen of values (H, W, 3), in 0 … 255."""
    colours = values.astype(np.float64)
    if kind == "display":
        colours = np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)
    colours = colours * 2**exposure
    if channel == "luminance":
        colours = np.repeat(colours @ (0.2126, 0.7152, 0.0722), 3).reshape(colours.shape)
    elif channel != "rgb":
        place = ("red", "green", "blue").index(channel)
        colours = colours[..., [place] * 3]
    if kind != "data":
        light = np.maximum(colours, 0.0)
        colours = np.where(light <= 0.0031308, 12.92 * colours, 1.055 * light ** (1 / 2.4) - 0.055)
    seen = np.clip(colours, 0.0, 1.0) ** (1 / gamma)
    if clipping:
        seen[colours.max(axis=2) > 0.995] = (1, 0.16, 0.1)
        seen[colours.max(axis=2) < 0.002] = (0.1, 0.35, 1)
        seen[np.isnan(values).any(axis=2)] = (1, 0, 1)
    return 255 * seen


def test_layers_are_shown_as_they_were_asked_for(opened: Opened, layered: Path) -> None:
    look = opened(layered, frame=1)
    values = np.linspace(-0.5, 3.0, 96 * 64 * 3, dtype=np.float32).reshape(64, 96, 3)
    values[5, 7] = np.nan
    for name in ("beauty", "position", "picture"):
        steps = np.rint(255 * np.clip(np.nan_to_num(values), 0, 1)).astype(np.uint8)
        script = as_script(f"{name}.js", name, steps if name == "picture" else values, 1.0)
        look.ask(f"review.viewing.layers.entries.set('{name}.js', null); {script}")
        look.wait(f"review.viewing.layers.get('{name}.js')")
        kind, low, high = look.ask(
            f"(({{ kind, low, high }}) => [kind, low, high])(review.viewing.layers.get('{name}.js'))"
        )
        given = steps if name == "picture" else values.astype(np.float16)
        for exposure, gamma, channel, clipping in (
            (0, 1, "rgb", False),
            (1.25, 1.8, "luminance", True),
            (-2, 0.6, "blue", True),
        ):
            asked = {"exposure": exposure, "gamma": gamma, "channel": channel, "clipping": clipping}
            seen = look.ask(
                f"""(settings) => {{
                  const {{ grader, layers }} = review.viewing;
                  grader.settings = settings;
                  const canvas = grader.graded(layers.get('{name}.js'));
                  return [...canvas.getContext('2d').getImageData(0, 0, 96, 64).data];
                }}""",
                asked,
            )
            shares = (given.astype(np.float64) - low) / (high - low)
            expected = graded(shares, kind, exposure, gamma, channel, clipping)
            apart = np.abs(np.reshape(seen, (64, 96, 4))[..., :3] - expected).max(axis=2)
            assert np.sort(apart.ravel())[-4] <= 2, (name, asked)


def test_the_beauty_is_shown_through_the_view_as_the_picture_is(opened: Opened, layered: Path) -> None:
    look = opened(layered, a="T010_tiny · look chrome · draft", frame=3)
    look.ask("review.viewing.layerOf(review.a, 3, 'picture')")
    look.press("Shift+V")
    wait_for_layers(look)
    look.wait("review.viewing.source(review.a, 3)")
    most = look.ask(
        """(() => {
          const { viewing, a } = review, canvas = viewing.source(a, 3);
          const picture = viewing.layerOf(a, 3, 'picture').bits;
          const card = canvas.getContext('2d').getImageData(0, 0, 480, 270).data;
          let most = 0;
          for (let i = 0; i < card.length; i++) {
            if (i % 4 < 3) most = Math.max(most, Math.abs(card[i] - picture[i]));
          }
          return most;
        })()"""
    )
    assert most <= 2


def test_exposure_channels_and_clipping_change_what_is_seen(opened: Opened, layered: Path) -> None:
    look = opened(layered, frame=1)
    look.press("Shift+R")
    wait_for_layers(look)
    plain = look.picture()
    look.press("Shift+K")
    clipped = look.picture()
    height, width = plain.shape[:2]
    white, black = (height // 4, width // 16), (int(0.8 * height), width // 2)
    assert clipped[white].tolist() == [255, 41, 26] and clipped[black].tolist() == [26, 89, 255]
    look.press("0")
    assert look.ask("review.viewing.isNeutral")
    look.press("PageDown", "PageDown", "PageDown", "PageDown")
    wait_for_layers(look)
    assert look.picture()[white][0] == pytest.approx(188, abs=2), "half the light of white"
    look.press("Shift+E")
    assert look.ask("review.viewing.isNeutral && !review.viewing.isOn")


def test_a_frame_without_layers_says_what_to_do(opened: Opened, desk: Desk, layered: Path) -> None:
    look = opened(layered, frame=3)
    look.press("Shift+E")
    assert "the nearest that has is 1" in look.tab.inner_text("#viewing")
    look.press("Shift+S")
    assert "the nearest that has is 1" in look.tab.inner_text("#message")
    look = opened(frame=3)
    look.press("Shift+E")
    assert "flowsculpt review --layers 8" in look.tab.inner_text("#viewing")
    look.press("/")
    look.tab.mouse.move(400, 300)
    assert look.tab.locator("#loupe").is_visible()
    look.press("/", "Shift+E")


def test_the_frame_is_saved_with_drawings_and_without(opened: Opened, layered: Path) -> None:
    look = opened(layered, frame=1)
    look.ask(
        """review.notes.add(review.a, 1, 1, {drawings: [{frame: 1, kind: "rectangle", ink: "#ff5a4d",
        width: 96, points: [4000, 3500, 6000, 5000], text: ""}]})"""
    )
    look.press("Shift+E")
    look.ask("review.viewing.layerOf(review.a, 1, 'picture')")
    wait_for_layers(look)
    saved = {}
    for key in ("Shift+S", "Shift+W"):
        with look.tab.expect_download() as download:
            look.press(key)
        path = look.scratch / download.value.suggested_filename
        download.value.save_as(path)
        saved[path.name] = read_png(path)[..., :3].astype(int)
    drawn, plain = saved[f"{NAME}.draft.0001.notes.png"], saved[f"{NAME}.draft.0001.png"]
    assert plain.shape == (270, 480, 3) and plain[30, 30].min() > 250
    assert (
        np.abs(drawn[168, 240] - [255, 90, 77]).max() < 12
        and np.abs(drawn[30, 30] - plain[30, 30]).max() == 0
    )


def test_axe_finds_nothing_on_layers(opened: Opened, layered: Path) -> None:
    look = opened(layered, frame=1)
    look.press("Shift+E", "Shift+P")
    look.tab.mouse.move(400, 300)
    wait_for_layers(look)
    assert look.findings() == []
