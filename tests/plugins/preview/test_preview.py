"""A preview shows what a render will: the same surfaces from the same cameras."""

from __future__ import annotations

import json
import resource
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from threading import Thread
from typing import Any

import av
import numpy as np
import pytest

from flowsculpt.pipeline.animation import MeshFrame, animate
from flowsculpt.pipeline.errors import FrameError, MachineError
from flowsculpt.pipeline.frames import FrameRange
from flowsculpt.pipeline.mesh import box, icosphere, sheet
from flowsculpt.pipeline.plugins.preview import surface_stream
from flowsculpt.pipeline.plugins.preview.animatic import (
    Animatic,
    framings_of,
    outline,
    size_for,
    write_film_animatic,
)
from flowsculpt.pipeline.plugins.preview.sketch import Sketch, is_closed
from flowsculpt.pipeline.plugins.preview.surface_stream import (
    MeshCache,
    MeshSource,
    SpillCache,
    SurfaceStream,
)
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.request.framing import Framer
from flowsculpt.pipeline.production.request.render_request import RenderRequest
from flowsculpt.pipeline.production.request.shot_source import ShotSource
from flowsculpt.pipeline.production.store.store import Store
from flowsculpt.render.movie.encode import LOOPS
from flowsculpt.render.movie.probe import probe_movie
from flowsculpt.render.post.image import read_png
from tests.conftest import TINY, ProjectFolder, lines

DISSOLVE = "loop={dissolve: 2}"

NAME = "T010_tiny"


def quiet(stage: str, number: int) -> None:
    """Nobody listens."""


def said(told: list[tuple[str, int]], stage: str, number: int) -> None:
    told.append((stage, number))


def take_of(root: Path, *settings: str) -> RenderRequest:
    project = Project(root, 2, settings=settings)
    return project.request(root / "shots" / f"{NAME}.yaml", "draft", None, variant="none")


@pytest.fixture
def root(tmp_path: Path) -> Path:
    (tmp_path / "shots").mkdir()
    (tmp_path / "shots" / f"{NAME}.yaml").write_text(TINY)
    return tmp_path


def test_frames_come_in_order_and_nothing_is_left_in_the_store(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(surface_stream, "SLOW", 60.0)
    request = take_of(root)
    with SurfaceStream(Project(root, 2).store) as stream:
        assert list(stream.play(request, [5, 2, 3])) == [2, 3, 5]
        assert stream.arrays(request, 3)["normals"].shape == stream.arrays(request, 3)["vertices"].shape
        assert not list(stream.store.entries())


def test_after_an_edit_only_what_it_changed_is_simulated_again(root: Path) -> None:
    with SurfaceStream(Project(root, 2).store) as stream:
        before = take_of(root)
        list(stream.play(before, range(1, 7)))
        known = dict(stream.meshes.frames)
        after = take_of(root, "flows.0.twist.amount={ease: linear, keys: {1: 0, 4: 36, 6: 90}}")
        list(stream.play(after, range(1, 7)))
        for number in range(1, 5):
            key = after.keys.mesh(number)
            assert key == before.keys.mesh(number) and stream.meshes.frames[key] is known[key]
        assert before.keys.mesh(6) not in stream.meshes.frames, "what no frame needs is forgotten"
        alone = {frame.number: frame for frame in animate(after.shot)}
        found = stream.meshes.frames[after.keys.mesh(6)]
        np.testing.assert_array_equal(found.mesh.vertices, alone[6].mesh.vertices)


def test_frames_that_took_long_are_kept_for_the_render(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(surface_stream, "SLOW", -1.0)
    request = take_of(root)
    with SurfaceStream(Project(root, 2).store) as stream:
        list(stream.play(request, range(1, 7)))
        assert all(stream.store.holds("mesh", request.keys.mesh(n)) for n in range(1, 7))
    plan = Project(root, 2).meshes([f"{root}/shots/{NAME}.yaml"], None)
    assert not plan.jobs


def test_frames_that_took_long_in_other_threads_are_kept_too(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def work() -> None:
        while time.thread_time() < 0.05:
            pass

    def animate_in_threads(*given: Any, **named: Any) -> Iterator[MeshFrame]:
        for frame in animate(*given, **named):
            thread = Thread(target=work)  # as flows move many points
            thread.start()
            thread.join()
            yield frame

    monkeypatch.setattr(surface_stream, "SLOW", 0.04)
    monkeypatch.setattr(surface_stream, "animate", animate_in_threads)
    request = take_of(root)
    with SurfaceStream(Project(root, 2).store) as stream:
        list(stream.play(request, range(1, 7)))
        assert all(stream.store.holds("mesh", request.keys.mesh(n)) for n in range(1, 7))


def test_cameras_are_those_of_the_render(root: Path) -> None:
    request = take_of(root)
    points = {frame.number: frame.mesh.vertices for frame in animate(request.shot)}
    numbers = sorted(points)
    views = [request.pictures.view(n) for n in numbers]
    aspect, follow = request.pictures.aspect, request.shot.picture.camera.follow
    expected = Framer(views, lambda i: points[numbers[i]], aspect, follow).all()
    with SurfaceStream(Project(root, 2).store) as stream:
        list(stream.play(request, numbers))
        found = framings_of(request, stream, numbers)
    for number, framing in zip(numbers, expected, strict=True):
        np.testing.assert_allclose(found[number].camera.origin, framing.camera.origin, atol=1e-5)
        np.testing.assert_allclose(found[number].placement.origin, framing.placement.origin, atol=1e-5)


def test_a_frame_that_fails_is_named_and_those_before_it_have_come(root: Path) -> None:
    request = take_of(root, "flows.0={vortex: {strength: {keys: {1: 0, 3: 0, 4: 1.0e+12}}}}")
    came = []
    with SurfaceStream(Project(root, 2).store) as stream, pytest.raises(FrameError, match="frame 4"):
        for number in stream.play(request, range(1, 7)):
            came.append(number)
    assert came == [1, 2, 3]


def test_what_has_no_room_in_memory_waits_on_the_disk() -> None:
    shelf = SpillCache(room=100.0)
    small, large = {"a": np.arange(5.0)}, {"a": np.arange(50.0), "b": np.arange(3, dtype=np.int32)}
    shelf.put("one", small)
    shelf.put("two", large)
    np.testing.assert_array_equal(shelf.get("two")["a"], large["a"])
    assert "one" in shelf and "two" in shelf and "three" not in shelf
    shelf.keep_only({"two"})
    assert "one" not in shelf and "two" in shelf
    shelf.keep_only(set())
    assert "two" not in shelf
    shelf.close()


def test_the_inside_is_left_out_only_where_nobody_can_see_it() -> None:
    ball = icosphere(3)
    arrays = {
        "vertices": ball.vertices,
        "normals": ball.vertices,
        "faces": ball.faces,
        "source_vertex": np.arange(len(ball.vertices), dtype=np.int32),
        "material": ball.vertices,
    }
    assert is_closed(arrays) and is_closed({"radii": np.ones(3)})
    assert not is_closed(arrays | {"faces": ball.faces[1:]})
    flat = sheet((2.0, 2.0))
    assert not is_closed(arrays | {"faces": flat.faces})
    split = box((1.0, 1.0, 1.0))
    assert is_closed(arrays | {"faces": split.faces})


def test_edges_are_drawn_where_they_are_asked_for(root: Path) -> None:
    request = take_of(root)
    with SurfaceStream(Project(root, 2).store) as stream:
        plain, edged = root / "plain.png", root / "edged.png"
        Animatic(Sketch(request), stream).still(3, plain, quiet)
        Animatic(Sketch(request, edges=True), stream).still(3, edged, quiet)
    first, second = (read_png(path).astype(float) for path in (plain, edged))
    assert first.shape == second.shape == (540, 960, 3) and size_for(1.0, (960, 540)) == (720, 720)
    darker = (first - second).max(axis=2)
    assert 0.01 < (darker > 10).mean() < 0.3 and darker[:50].max() == 0


@pytest.mark.slow
def test_pictures_of_a_range_are_those_of_the_whole(root: Path) -> None:
    whole = take_of(root)
    with SurfaceStream(Project(root, 2).store) as stream:
        Animatic(Sketch(whole), stream).still(5, root / "one.png", quiet)
        part = replace(whole, requested=(4, 5))
        Animatic(Sketch(part), stream).still(5, root / "two.png", quiet)
    assert (root / "one.png").read_bytes() == (root / "two.png").read_bytes()


LONG = ("frames=1-80", "flows.0.twist.amount={ease: linear, keys: {1: 0, 80: 90}}")


@pytest.mark.slow
def test_pictures_are_drawn_while_later_frames_are_simulated_and_are_forgotten(root: Path) -> None:
    request, told = take_of(root, *LONG), []
    with SurfaceStream(Project(root, 2).store, once=True) as stream:
        assert (
            Animatic(Sketch(request), stream).movie(root / "long.mp4", lambda *what: told.append(what)) == 80
        )
        assert told.index(("drawing", 1)) < told.index(("simulating", 80))
        assert not stream.meshes.frames
        with pytest.raises(FileNotFoundError):
            stream.arrays(request, 1)
    assert [n for stage, n in told if stage == "drawing"] == list(range(1, 81))


@pytest.mark.slow
def test_a_film_holds_no_frame_of_a_clip_that_is_over_and_few_of_the_clip_that_is_drawn(root: Path) -> None:
    (root / "shots" / "three.yaml").write_text(
        "title: Three\nshots:\n"
        + "".join(f"  - {{shot: {NAME}, frames: {part}}}\n" for part in ("40-42", "1-4", "70-72"))
        + "title_seconds: 0\ncredits_seconds: 0\n"
    )
    project = Project(root, 2, settings=LONG)
    edit, requests = project.edit("draft", root / "shots" / "three.yaml", variant="none")
    clips = [Animatic(Sketch(each), SurfaceStream(project.store, once=True)) for each in requests]
    held: list[int] = []

    def known(clip: Animatic) -> int:
        request = clip.sketch.request
        return sum(clip.stream.knows(request, number) for number in request.shot.frames)

    def tell(stage: str, number: int) -> None:
        if stage == "drawing":
            held.append(sum(map(known, clips)))

    assert write_film_animatic(edit, clips, root / "three.mp4", tell) == len(held) == 10
    assert held[2] == held[6] == held[9] == 0, "after the last picture of each clip"
    assert max(held) < 2 * Framer.AHEAD, "frames that only cameras see are forgotten too"


def test_a_movie_of_every_fourth_frame_holds_each_and_is_as_long(root: Path) -> None:
    request = take_of(root)
    with SurfaceStream(Project(root, 2).store) as stream:
        whole, held = (list(Animatic(Sketch(request), stream, every).pictures(quiet)) for every in (1, 4))
    assert len(whole) == len(held) == 6
    for number, picture in enumerate(held):
        np.testing.assert_array_equal(picture, whole[0 if number < 4 else 4])
    assert not np.array_equal(whole[0], whole[4])


def test_the_progress_of_a_movie_of_every_fourth_frame_ends_at_its_total(root: Path) -> None:
    request, told = take_of(root, *LONG), list[tuple[str, int]]()
    part = replace(request, requested=FrameRange([74, 75, 76]))
    with SurfaceStream(Project(root, 2).store) as stream:
        animatic = Animatic(Sketch(part), stream, 4)
        assert len(list(animatic.pictures(partial(said, told)))) == 3
    assert [n for what, n in told if what == "simulating"] == animatic.played_for_movie()


def test_of_a_range_no_frame_is_shaded_that_neither_picture_nor_camera_shows(root: Path) -> None:
    request, told = take_of(root, *LONG), list[tuple[str, int]]()
    part = replace(request, requested=FrameRange([75]))
    with SurfaceStream(Project(root, 2).store) as stream:
        (alone,) = Animatic(Sketch(part), stream).pictures(partial(said, told))
        assert told == [("simulating", n) for n in range(75 - Framer.AHEAD, 81)]
        whole = list(Animatic(Sketch(request), stream).pictures(quiet))
    np.testing.assert_array_equal(alone, whole[74])


@pytest.mark.slow
def test_a_still_simulates_no_frame_after_its_own_and_has_the_camera_of_the_movie(root: Path) -> None:
    growing = "flows.0={scaling: {rate: [0.3, 0.1, 0]}}"
    for settings in (LONG, (*LONG, growing), (*LONG, growing, "camera.follow=0")):
        request, told = take_of(root, *settings), list[tuple[str, int]]()
        with SurfaceStream(Project(root, 2).store) as stream:
            animatic = Animatic(Sketch(request), stream)
            still = animatic.still(20, root / "early.png", partial(said, told))
            assert told == [*(("simulating", n) for n in range(1, 21)), ("drawing", 20)]
            list(stream.play(request, range(1, 81)))
            movie = framings_of(request, stream, list(range(1, 81)))[20]
        size = movie.placement.size
        np.testing.assert_allclose(still.camera.origin, movie.camera.origin, atol=0.002 * size)
        np.testing.assert_allclose(still.placement.origin, movie.placement.origin, atol=0.002 * size)


def test_a_still_is_drawn_though_a_later_frame_fails(root: Path) -> None:
    failing = "flows.0={vortex: {strength: {keys: {1: 0, 30: 0, 40: 1.0e+12}}}}"
    request = take_of(root, LONG[0], failing)
    with SurfaceStream(Project(root, 2).store) as stream:
        Animatic(Sketch(request), stream).still(3, root / "early.png", quiet)
    assert (root / "early.png").exists()


def test_a_sample_of_points_has_the_outermost() -> None:
    points = np.random.default_rng(2).normal(size=(50_000, 3))
    chosen = points[outline(points)]
    assert 3500 <= len(chosen) < 4500
    for direction in np.eye(3):
        assert (chosen @ direction).max() > 0.93 * (points @ direction).max()


def test_an_unwritable_place_is_told_before_anything_is_simulated(project: ProjectFolder) -> None:
    (project.path / "file").write_text("")
    done = project.run("preview", NAME, "-o", "file/movie.mp4")
    assert done.code == 4 and len(done.err.strip().splitlines()) == 1 and "file" in done.err


def test_speeds_shown_as_colours_are_found_again_after_an_edit(root: Path) -> None:
    speed = "look={material: clay, measure: {speed: {range: [0, 5]}}}"
    twist = "flows.0.twist.amount={ease: linear, keys: {1: 0, 4: 72, 6: 120}}"
    fastest = []
    with SurfaceStream(Project(root, 2).store) as stream:
        for settings in ((), (speed,), (speed, twist)):
            request = take_of(root, *settings)
            list(stream.play(request, [1]))
            arrays = stream.arrays(request, 1)
            fastest.append(float(arrays["speed"].max()) if "speed" in arrays else 0.0)
    assert fastest[0] == 0.0 < fastest[1] and fastest[2] == pytest.approx(2.0 * fastest[1], rel=0.01)


def test_a_full_disk_is_told_where_surfaces_wait_and_leaves_nothing() -> None:
    shelf = SpillCache(room=0.0)
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limit[1]))
    try:
        with pytest.raises(MachineError):
            shelf.put("one", {"a": np.arange(5000.0)})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    assert "one" not in shelf
    shelf.close()


def test_meshes_in_memory_have_the_numbers_of_a_shot_whose_frames_were_moved(tmp_path: Path) -> None:
    def source(frames: str) -> MeshSource:
        text = f"title: A\nframes: {frames}\nsubject: {{solid: box}}\nresample: off\nflows: []\n"
        shot = ShotSource(text, tmp_path / "A.yaml")
        request = RenderRequest(shot, "draft", "none", tuple(shot.manifest.frames))
        return MeshSource(request, Store(tmp_path), cache, lambda progress: None)

    cache = MeshCache()
    assert source("1-3").at(3).number == 3
    assert source("1001-1003").at(1003).number == 1003 and len(cache.frames) == 3


def test_a_preview_is_drawn_without_rendering(project):
    done = project.call("--json", "preview", NAME, "--at", "3", "--flow")
    assert done.code == 0, done.err
    made = json.loads(done.out)["path"]
    assert made.endswith("renders/T010_tiny/preview/T010_tiny.0003.flow.png")
    assert read_png(Path(made)).shape == (540, 960, 3)
    done = project.call("--json", "preview", NAME, "-f", "2-3", "-o", "two.mp4")
    assert done.code == 0 and probe_movie(project.path / "two.mp4").frames == 2, done.err
    assert not list(project.path.rglob("*.exr"))
    for words, says in ((("--at", "9"), "1-6"), (("--at", "2", "-o", "a.mp4"), ".png")):
        bad = project.call("preview", NAME, *words)
        assert bad.code == 2 and says in bad.err and len(lines(bad.err)) == 1


def movie(path) -> tuple[int, str]:
    with av.open(str(path)) as container:
        comment = container.metadata.get("comment", "")
        return sum(1 for _ in container.decode(video=0)), comment


def test_previews_of_loops_dissolve_too(project):
    done = project.call("preview", "T010_tiny", "--set", DISSOLVE)
    assert done.code == 0, done.err
    (path,) = (project.path / "renders" / "T010_tiny" / "preview").glob("*.mp4")
    assert movie(path) == (4, LOOPS)
