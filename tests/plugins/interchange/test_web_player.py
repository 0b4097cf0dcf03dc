"""A page that plays a sculpture: it needs no network, shows each frame, and can be turned and scrubbed."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import Browser
from playwright.sync_api import Page as Tab

from flowsculpt.pipeline.mesh import icosphere
from flowsculpt.pipeline.plugins.interchange.animated_gltf import Moving
from flowsculpt.pipeline.plugins.interchange.drawn_mesh import DrawnMesh, KeyPoses
from flowsculpt.pipeline.plugins.interchange.web_player import (
    FOLD,
    WebPage,
    differences,
    folded,
    irradiance,
    planes,
)
from flowsculpt.pipeline.production.request.framing import Framing
from flowsculpt.pipeline.shot import read_shot
from flowsculpt.render.base.input_files import InputFile
from flowsculpt.render.graphics.three_js import installed_file
from flowsculpt.render.post.image import read_png, write_png
from flowsculpt.render.scene import clear_sky
from flowsculpt.render.scene.materials import Diffuse, Painted
from flowsculpt.render.scene.painted_faces import PaintedFaces
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.scene_lights import LightRig, Sky, Softbox
from flowsculpt.render.scene.scene_stage import StagePlacement
from flowsculpt.render.scene.sky import Daylight
from flowsculpt.render.scene.texture_projection import TextureProjection
from flowsculpt.render.scene.textures import Texture
from tests.chromium import LIMIT, wait_for
from tests.page_flaws import flaws
from tests.plugins.interchange.moving_meshes import moving, painted

SHOT = """\
title: Twisted <b>
frames: 1-24
subject: {solid: icosphere}
resample: {max_edge_length: 0.3}
flows: []
"""
SIZE = (480, 270)
SEEN, COARSE = 0.5, 0.25
"""Dots for a pixel, and where no picture is looked at: the processor draws them, a frame in up to seconds."""


def test_differences_and_planes_are_undone_by_sums() -> None:
    values = np.random.default_rng(4).integers(-16000, 16000, (3, 5, 3))
    content = planes(differences(values).astype("<i2"))
    low, high = content.reshape(3, 3, 2, 5).transpose(2, 0, 3, 1)
    again = (low.astype(np.uint16) | high.astype(np.uint16) << 8).astype(np.int16)
    sums = np.cumsum(np.cumsum(again, axis=0, dtype=np.int16), axis=1, dtype=np.int16)
    assert np.array_equal(sums, values)


def test_light_on_the_floor_is_that_of_the_softboxes_and_the_sky() -> None:
    box = Softbox((0.0, 10.0, 0.0), 1.0, 1.0, (100.0, 50.0, 0.0), target=(0.0, 0.0, 0.0))
    up = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
    light = irradiance(LightRig((box,), sky=Sky((1, 1, 1), (1, 1, 1), (1, 1, 1))), np.zeros((2, 3)), up)
    assert np.allclose(light[0], np.array([1.0, 0.5, 0.0]) + math.pi, rtol=0.01)
    assert np.allclose(light[1], math.pi)


@pytest.mark.parametrize("elevation", [8.0, 32.0, 70.0])
def test_light_on_the_floor_is_that_of_the_sun_and_sky_of_renders(elevation: float) -> None:
    daylight = Daylight(math.radians(elevation))
    light = irradiance(LightRig(daylight=daylight), np.zeros((1, 3)), np.array([[0.0, 1.0, 0.0]]))[0]
    sky = clear_sky.sky_pixels(daylight)[:64].mean(axis=1)
    tilt = (np.arange(64) + 0.5) / 128 * math.pi
    expected = 2.0 * math.pi * (math.pi / 128) * (np.cos(tilt) * np.sin(tilt)) @ sky
    expected += math.sin(daylight.elevation) * np.array(clear_sky.sun_irradiance(daylight))
    np.testing.assert_allclose(light, expected, rtol=0.01)


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if not installed_file().exists():
        pytest.skip("three.js is not set up here")
    place = tmp_path_factory.mktemp("web")
    shot = read_shot(place / "a.yaml", SHOT)
    mesh = painted(moving(icosphere(8)))
    part = Moving("ball", KeyPoses.of(DrawnMesh.of(mesh)), shot.picture.look)
    camera = Camera((1.5, 0.5, 12.0), (1.5, 0.0, 0.0))
    framing = Framing(camera, StagePlacement((1.5, -1.0, 0.0), 1.5))
    WebPage(shot, [part], dict.fromkeys(mesh.frames, framing), 16 / 9).write(place / "page.html")
    return place / "page.html"


@pytest.fixture(scope="module")
def shown(browser: Browser, page: Path) -> Iterator[Tab]:
    """The page for tests that look at it and change nothing but its frame."""
    with opened(browser, page) as tab:
        yield tab


@pytest.fixture(scope="module")
def used(browser: Browser, page: Path) -> Iterator[Tab]:
    """The page for tests that use it, whose picture is coarse."""
    with opened(browser, page, COARSE) as tab:
        yield tab


@pytest.fixture
def tab(used: Tab) -> Tab:
    """The page that tests use, at its first frame, as its camera sees it."""
    used.evaluate("flowsculpt.transport.pause(); flowsculpt.transport.jump(1)")
    assert used.evaluate("flowsculpt.player.follows")
    return used


@contextmanager
def opened(browser: Browser, page: Path, dots: float = SEEN) -> Iterator[Tab]:
    """A page without a network; it must neither complain nor ask for anything.

    dots  in each direction for a pixel of its style sheet
    """
    context = browser.new_context(
        viewport={"width": SIZE[0], "height": SIZE[1]},
        device_scale_factor=dots,
        reduced_motion="reduce",
        offline=True,
    )
    context.set_default_timeout(1000 * LIMIT)
    tab, complaints, asked = context.new_page(), list[str](), list[str]()
    tab.on(
        "console", lambda said: complaints.append(said.text) if said.type in ("error", "warning") else None
    )
    tab.on("pageerror", lambda error: complaints.append(str(error)))
    tab.on("request", lambda request: asked.append(request.url))
    tab.goto(page.as_uri())
    wait_for(tab, "window.flowsculpt || document.getElementById('wait').textContent")
    yield tab
    context.close()
    assert [each for each in complaints if "GPU stall" not in each] == []
    assert [url for url in asked if not url.startswith(("file:", "blob:", "data:"))] == []


def picture(tab: Tab, place: Path, number: float, playing: bool = False) -> NDArray[np.uint8]:
    """What the page shows of a frame, or when it is played there, without its bar."""
    play = "const { transport } = flowsculpt; transport.frame = transport.first; transport.playing = true;"
    tick = f"{play} transport.glide((number - transport.first) / facts.rate); transport.pause();"
    tab.evaluate(f"(number) => {{ {tick if playing else 'flowsculpt.transport.jump(number)'} }}", number)
    tab.evaluate("document.documentElement.classList.add('bare')")
    tab.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    tab.screenshot(path=str(place / "seen.png"))
    return read_png(place / "seen.png")[..., :3]


def test_the_page_shows_the_sculpture_where_each_frame_has_it(shown: Tab, tmp_path: Path) -> None:
    middles = []
    for number in (1, 12.5, 24):
        colours = picture(shown, tmp_path, number).astype(int)
        coloured = np.ptp(colours, axis=2) > 60  # the sculpture; the floor is grey
        assert 0.02 < coloured.mean() < 0.3
        middles.append(np.nonzero(coloured)[1].mean() / SEEN)
    across = 2 * 12.0 * math.tan(math.radians(13.0))
    moved = 1.5 * SIZE[0] / across  # it drifts by 3 units in all
    assert np.allclose(np.diff(middles), moved, atol=0.05 * SIZE[0])


def test_positions_on_the_page_are_those_of_the_keyframes(shown: Tab) -> None:
    mesh = moving(icosphere(8))
    keys = KeyPoses.of(DrawnMesh.of(mesh))
    for index, places in enumerate(keys.places):
        rows = shown.evaluate(
            "(pose) => Array.from(flowsculpt.player.sculptures[0].positions[pose].data.array)", index
        )
        read = np.array(rows).reshape(-1, 4)[:, :3]
        assert len(read) >= len(places)  # the painted ball has a seam
        assert {tuple(row) for row in read.tolist()} == {tuple(row) for row in places.tolist()}


def test_normals_on_the_page_are_those_of_the_keyframes(shown: Tab) -> None:
    rows = shown.evaluate("Array.from(flowsculpt.player.sculptures[0].normals[0].data.array)")
    read = np.array(rows).reshape(-1, 4)[:, :3] / 32767.0
    normals = KeyPoses.of(DrawnMesh.of(painted(moving(icosphere(8))))).normals[0]
    assert np.linalg.norm(read - normals, axis=1).max() < math.radians(0.12)


def test_folded_normals_along_axes_are_exact() -> None:
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    corners = [(FOLD, 0), (0, FOLD), (0, 0), (-FOLD, 0), (0, -FOLD), (FOLD, FOLD)]
    assert folded(axes).tolist() == [list(corner) for corner in corners]
    assert folded(np.zeros((1, 3))).tolist() == [[0, 0]], "a vertex without area has no normal"


@pytest.mark.parametrize(
    "loop",
    [
        ("dissolve", 8),
        pytest.param(("back", 0), marks=pytest.mark.soak),
        pytest.param(("turns", 0), marks=pytest.mark.soak),
    ],
)
def test_a_loop_meets_its_first_frame(browser: Browser, tmp_path: Path, loop: tuple[str, int]) -> None:
    if not installed_file().exists():
        pytest.skip("three.js is not set up here")
    shot = read_shot(tmp_path / "a.yaml", SHOT)
    back = loop[0] == "back"
    mesh = moving(icosphere(4))
    if back:  # its frame 24 is as far from frame 1 as frame 2 is
        there = mesh.points_at
        mesh = replace(mesh, points_at=lambda number: there(1 + min(number - 1, 25 - number)))
    part = Moving("ball", KeyPoses.of(DrawnMesh.of(mesh)), shot.picture.look)
    framing = Framing(Camera((1.5, 0.5, 12.0), (1.5, 0.0, 0.0)), StagePlacement((1.5, -1.0, 0.0), 1.5))
    page = WebPage(shot, [part], dict.fromkeys(mesh.frames, framing), 16 / 9, loop)
    page.write(tmp_path / "page.html")
    with opened(browser, tmp_path / "page.html", COARSE) as tab:
        first = 1 + loop[1]
        assert tab.evaluate("[facts.meets, flowsculpt.player.number]") == [back, first]
        assert tab.evaluate("[flowsculpt.transport.last, flowsculpt.transport.tail]") == [24, 1]
        begins, ends, between = (picture(tab, tmp_path, number, True) for number in (first, 24.99, 20))
    apart = np.abs(begins.astype(int) - ends).mean()
    assert (
        apart < 0.2 if loop[0] != "turns" else apart > 1.0
    )  # vertices that do not return are not moved back
    if loop[0] == "dissolve":  # two balls are seen
        assert np.abs(begins.astype(int) - between).mean() > 1.0


def test_keys_and_the_bar_move_through_time_and_dragging_leaves_the_shots_camera(tab: Tab) -> None:
    tab.keyboard.press("ArrowRight")
    assert tab.input_value("#frame") == "2"
    tab.keyboard.press("End")
    assert tab.input_value("#frame") == "24"
    tab.keyboard.press(" ")
    wait_for(tab, "flowsculpt.transport.playing && flowsculpt.player.number < 20")
    tab.keyboard.press(" ")
    assert not tab.evaluate("flowsculpt.transport.playing")
    before = tab.evaluate("flowsculpt.player.camera.position.toArray()")
    tab.mouse.move(240, 100)
    tab.mouse.down()
    tab.mouse.move(300, 120, steps=4)
    tab.mouse.up()
    wait_for(tab, "document.getElementById('follow').getAttribute('aria-pressed') === 'false'")
    assert tab.evaluate("flowsculpt.player.camera.position.toArray()") != before
    tab.keyboard.press("c")
    wait_for(tab, "flowsculpt.player.follows")
    assert np.allclose(tab.evaluate("flowsculpt.player.camera.position.toArray()"), before, atol=1e-6)


def test_the_page_is_used_in_light_and_dark_on_a_phone_and_by_keys_alone(tab: Tab) -> None:
    assert flaws(tab, 8) == []
    tab.evaluate("document.activeElement.blur()")
    tab.keyboard.press("Tab")
    before = tab.evaluate("flowsculpt.player.orbit.view")
    tab.keyboard.press("ArrowRight")
    tab.keyboard.press("t")
    tab.keyboard.press("ArrowUp")
    after = tab.evaluate("flowsculpt.player.orbit.view")
    assert not np.allclose(before["position"], after["position"]) and not np.allclose(
        before["up"], after["up"]
    )
    away = [np.linalg.norm(np.subtract(view["position"], view["target"])) for view in (before, after)]
    assert math.isclose(*away, rel_tol=1e-9) and tab.input_value("#frame") == "1"


@pytest.mark.soak
def test_a_hazy_horizon_has_no_line_on_the_page(browser: Browser, tmp_path: Path) -> None:
    if not installed_file().exists():
        pytest.skip("three.js is not set up here")
    steps = []
    for fade in ("", ", horizon_fade: 8"):
        text = f"{SHOT}lights: bright_field\nstage: {{kind: ground{fade}}}\n"
        shot = read_shot(tmp_path / "a.yaml", text)
        mesh = painted(moving(icosphere(4)))
        part = Moving("ball", KeyPoses.of(DrawnMesh.of(mesh)), shot.picture.look)
        framing = Framing(Camera((1.5, 0.5, 12.0), (1.5, 0.5, 0.0)), StagePlacement((1.5, -1.0, 0.0), 1.5))
        WebPage(shot, [part], dict.fromkeys(mesh.frames, framing), 16 / 9).write(tmp_path / "page.html")
        with opened(browser, tmp_path / "page.html") as tab:
            column = picture(tab, tmp_path, 1)[10:-30, 2].astype(float).sum(axis=1)
        steps.append(np.abs(np.diff(column)).max() / np.ptp(column))
    assert steps[1] < 0.5 * steps[0]


def test_each_material_of_a_model_shows_its_picture_or_colour(browser: Browser, tmp_path: Path) -> None:
    if not installed_file().exists():
        pytest.skip("three.js is not set up here")
    pixels = np.zeros((16, 16, 3), np.uint8)
    pixels[:8], pixels[8:] = (0, 200, 0), (0, 0, 200)  # green above blue
    write_png(tmp_path / "a.png", pixels)
    write_png(tmp_path / "flat.png", np.full((4, 4, 3), (128, 128, 255), np.uint8))
    texture, flat = (
        Texture.of(str(path), InputFile(path).digest(), space)
        for path, space in ((tmp_path / "a.png", None), (tmp_path / "flat.png", "data"))
    )
    more = {"normal_texture": flat, "projection": TextureProjection("model")}
    pictured = Diffuse((1, 1, 1), colour_texture=texture, **more)
    look = Painted((1, 1, 1), parts=(pictured, Diffuse((0.6, 0.0, 0.0))))
    mesh = painted(moving(icosphere(8), frames=range(1, 3)))
    assert mesh.texture is not None
    is_right = (mesh.rest[mesh.faces].mean(axis=1)[:, 0] > 0.0).astype(np.int64)
    mesh = replace(mesh, paint=PaintedFaces(mesh.texture, 0 * is_right, is_right))
    shot = read_shot(tmp_path / "a.yaml", SHOT)
    framing = Framing(Camera((0.0, 0.0, 6.0), (0.0, 0.0, 0.0)), StagePlacement((0.0, -1.0, 0.0), 1.0))
    part = Moving("ball", KeyPoses.of(DrawnMesh.of(mesh)), look)
    WebPage(shot, [part], dict.fromkeys(mesh.frames, framing), 16 / 9).write(tmp_path / "page.html")
    with opened(browser, tmp_path / "page.html") as tab:
        colours = picture(tab, tmp_path, 1)
    red, green, blue = (
        np.argwhere((colours[..., k] > 60) & (colours[..., k] > 1.5 * np.delete(colours, k, 2).max(axis=2)))
        for k in range(3)
    )
    middle, near = SEEN * SIZE[0] / 2, SEEN * 20
    assert min(map(len, (red, green, blue))) > 500 * SEEN**2
    assert red[:, 1].min() > middle - near and max(green[:, 1].max(), blue[:, 1].max()) < middle + near
    assert green[:, 0].mean() < blue[:, 0].mean()
