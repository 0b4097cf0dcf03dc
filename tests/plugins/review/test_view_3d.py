"""The 3-D view: all frames as one mesh, and simulated ones, whose surfaces and clouds are drawn together."""

from __future__ import annotations

import base64
import json
import shutil
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from flowsculpt.pipeline.mesh import icosphere
from flowsculpt.pipeline.plugins.review import view_3d
from flowsculpt.pipeline.plugins.review.view_3d import PageMeshes
from flowsculpt.pipeline.production.shot_extras import Animation, ShotExtras
from flowsculpt.render.graphics.three_js import installed_file
from tests.needed_plugins import needs_plugins
from tests.plugins.review.looker import Opened
from tests.simulated_show import LAST, NAME, SHOT, Desk, simulated

Arrays = dict[str, NDArray[np.generic]]


def ball(middle: tuple[float, float, float], radius: float) -> Arrays:
    """A sphere of triangles, as normals files hold one."""
    mesh = icosphere(10)
    normals = mesh.vertices / np.linalg.norm(mesh.vertices, axis=1, keepdims=True)
    return {"vertices": normals * radius + middle, "normals": normals, "faces": mesh.faces}


def cloud(middles: list[tuple[float, float, float]], radii: list[float]) -> Arrays:
    return {"vertices": np.array(middles), "radii": np.array(radii, np.float32)}


def test_surfaces_and_clouds_of_a_frame_come_together() -> None:
    subjects = [ball((0, 0, 0), 1.0), cloud([(3, 0, 0), (4, 0, 0)], [0.5, 0.25]), ball((0, 5, 0), 1.0)]
    text = view_3d.as_script("m.js", view_3d.joined(subjects))
    data = json.loads(text.removeprefix('reviewModel("m.js", ').removesuffix(");\n"))
    assert (data["triangles"], data["points"]) == (2 * len(icosphere(10).faces), 2)
    assert np.allclose((data["low"], data["high"]), [(-1, -1, -1), (4.25, 6, 1)], atol=0.01)
    centres = np.frombuffer(base64.b64decode(data["centres"]), "<u2").reshape(-1, 3)
    assert np.allclose(data["low"] + centres * data["step"], [(3, 0, 0), (4, 0, 0)], atol=1e-4)
    assert np.frombuffer(base64.b64decode(data["radii"]), "<f4").tolist() == [0.5, 0.25]


@pytest.fixture
def page_of(desk: Desk, tmp_path: Path) -> Callable[..., Path]:
    """A page whose meshes are replaced by others."""

    def written(*subjects: Arrays) -> Path:
        folder = Path(shutil.copytree(desk.page().parent, tmp_path / f"page{len(list(tmp_path.iterdir()))}"))
        for script in (folder / "models").iterdir():
            script.write_text(view_3d.as_script(script.name, view_3d.joined(subjects)))
        return folder / "index.html"

    return written


@pytest.mark.skipif(not installed_file().exists(), reason="three.js is not set up here")
def test_a_point_is_drawn_beside_a_surface_and_as_large_as_one(
    opened: Opened, page_of: Callable[..., Path]
) -> None:
    box = cloud([(-3, -1.5, 0), (3, 1.5, 0)], [1e-3, 1e-3])
    lit = []
    for subject in (ball((1.5, 0, 0), 1.0), cloud([(1.5, 0, 0)], [1.0])):
        look = opened(page_of(ball((-1.5, 0, 0), 0.8), subject, box), frame=1)
        look.press("m")
        look.wait("review.panels.mesh.view?.shownName")
        lit.append(look.seen(".mesh-stage").max(axis=2) > 40)
        assert "triangles and " in look.tab.inner_text("#panel-mesh .note")
    middle = lit[0].shape[1] // 2
    assert (lit[0][:, :middle] == lit[1][:, :middle]).mean() > 0.999
    surface, points = (each[:, middle:].sum() for each in lit)
    assert 0.03 * lit[0].size < surface and 0.93 < points / surface < 1.07


needs_three_js = pytest.mark.skipif(not installed_file().exists(), reason="three.js is not set up here")


@needs_three_js
def test_the_motion_looks_as_the_simulated_frames_do_in_each(opened: Opened) -> None:
    look = opened(frame=1)
    look.press("m")
    look.wait("review.panels.mesh.view?.shownName")
    pictures = []
    for number in (1, 13, LAST):
        look.ask("(number) => review.transport.jump(number)", number)
        seen = []
        for words in ("one mesh in all frames", "[0-9] triangles"):
            look.wait(
                f"/^Frame {number}, .*{words}$/.test(document.querySelector('#panel-mesh .note').textContent)"
            )
            seen.append(look.seen(".mesh-stage").astype(int))
            look.press("Shift+M")
        moving, still = seen
        assert ((moving.max(axis=2) > 40) == (still.max(axis=2) > 40)).mean() > 0.995
        assert np.abs(moving - still).mean() < 1.0
        pictures.append(moving)
    assert np.abs(pictures[0] - pictures[1]).mean() > 2.0 < np.abs(pictures[1] - pictures[2]).mean()


@needs_three_js
def test_the_motion_plays_in_step_with_the_film_and_keeps_a_camera_that_was_turned(opened: Opened) -> None:
    look = opened(frame=1)
    look.press("m")
    look.wait("review.panels.mesh.view?.shownNumber === 1")
    look.ask("review.transport.setNumbers([2, 3, 4, 5, 6], 24)")
    look.ask("""(() => {
        window.steps = [];
        const panel = review.panels.mesh.view, show = panel.shown.show.bind(panel.shown);
        panel.shown.show = (frame) => { steps.push([frame, show(frame)]); return show(frame); };
    })()""")
    look.press(" ")
    look.wait("steps.length > 12")
    look.press(" ")
    steps = look.ask("steps")
    assert all(asked == shown for asked, shown in steps) and {asked for asked, _ in steps} == {2, 3, 4, 5, 6}
    box = look.tab.locator(".mesh-stage").bounding_box()
    assert box
    look.tab.mouse.move(box["x"] + 100, box["y"] + 100)
    look.tab.mouse.down()
    look.tab.mouse.move(box["x"] + 160, box["y"] + 120, steps=3)
    look.tab.mouse.up()
    camera = "review.panels.mesh.view.camera.position.toArray()"
    turned = look.ask(camera)
    look.press("ArrowRight", "Shift+M", "Shift+M")
    assert look.ask(camera) == turned
    look.press("c")
    assert look.ask(camera) != turned


@needs_three_js
def test_a_motion_that_cannot_be_read_leaves_the_simulated_frames(
    opened: Opened, desk: Desk, tmp_path: Path
) -> None:
    folder = Path(shutil.copytree(desk.page().parent, tmp_path / "page"))
    (file,) = (path for path in (folder / "models").iterdir() if '"glb"' in path.read_text())
    file.write_text(f'reviewModel("{file.name}", {{"glb": "AAAA"}});')
    look = opened(folder / "index.html", frame=5)
    look.press("m")
    look.wait("review.panels.mesh.view?.shownName")
    words = look.tab.inner_text("#panel-mesh .note")
    assert words.startswith("Frame 5, ") and "It does not play: " in words and "\n" not in words
    assert not look.tab.get_by_role("button", name="Motion").is_visible()


SHORT = SHOT.replace(f"frames: 1-{LAST}", "frames: 1-3").replace(f"16: 36, {LAST}: 60", "3: 60")


BOX, BALLS = "{solid: box, size: [2, 2, 2]}", "{cloud: {solid: icosphere, radius: 1}, count: 9, radius: 0.1}"
CLOUD = SHORT.replace(BOX, BALLS).replace("{max_edge_length: 0.5}", "off")


def meshes_of(desk: Desk) -> PageMeshes:
    return PageMeshes(desk.request("draft"), desk.project().store, desk.root)


@needs_plugins("points")
@pytest.mark.parametrize(
    ("shot", "why"),
    [
        pytest.param(
            SHORT.replace("0.5}", "0.5, placement: chord}", 1),
            "placement chord puts new vertices beside",
            marks=needs_plugins("interchange"),
        ),
        pytest.param(
            SHORT.replace("0.5}", "0.5, method: polyhedra}", 1),
            "polyhedra cuts other faces in each frame",
            marks=needs_plugins("interchange", "polyhedra"),
        ),
        pytest.param(
            CLOUD, "points and control nets have no triangles", marks=needs_plugins("interchange", "points")
        ),
        ("another", "has changed since frame 2 was simulated"),
        ("no plug-in", "no plug-in makes animations."),
        pytest.param(
            "large",
            f"{NAME} has 296 vertices at rest, so one mesh of it cannot have 20.",
            marks=needs_plugins("interchange"),
        ),
    ],
)
def test_a_shot_without_motion_says_why_in_a_line(
    shot: str, why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    desk = simulated(tmp_path, shot if ":" in shot else SHORT)
    file = tmp_path / "shots" / f"{NAME}.yaml"
    if shot == "another":
        file.write_text(file.read_text().replace("3: 60", "3: 50"))
    if shot == "no plug-in":
        monkeypatch.setattr(ShotExtras, "of_plugins", dict)
    if shot == "large":
        monkeypatch.setattr(view_3d, "MOST_VERTICES", 20)
    found = meshes_of(desk).write_motion(lambda name, total: lambda: None)
    assert list(found) == ["without"] and why in found["without"] and "\n" not in found["without"]


def test_another_plug_in_may_make_the_motion_which_is_kept_by_its_key(
    desk: Desk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = []

    class Knitting(ShotExtras):
        def animation(self, request: object, store: object, most_vertices: int) -> Animation:
            def glb(began: Callable[[str, int], Callable[[], None]]) -> bytes:
                began("knitting", 1)()
                made.append(most_vertices)
                return b"glTF of a stranger"

            return Animation("f00", glb)

    extras = {"silent": ShotExtras(), "stranger": Knitting()}
    monkeypatch.setattr(ShotExtras, "of_plugins", lambda: extras)
    meshes = PageMeshes(desk.request("draft"), desk.project().store, tmp_path)
    bars: list[str] = []
    for _ in range(2):
        found = meshes.write_motion(lambda name, total: bars.append(name) or (lambda: None))  # type: ignore[func-returns-value]
    assert (made, bars, found["first"]) == ([view_3d.MOST_VERTICES], ["knitting"], 1)
    script = (tmp_path / found["file"]).read_text()
    data = json.loads(script.removeprefix(f'reviewModel("{found["file"]}", ').removesuffix(");\n"))
    assert zlib.decompress(base64.b64decode(data["glb"])) == b"glTF of a stranger"
