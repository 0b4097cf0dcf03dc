"""A picture that was ended half done goes on from its last pass, to the very same bits."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from flowsculpt import render
from flowsculpt.render.frame import checkpoint
from flowsculpt.render.frame.checkpoint import Checkpoint
from flowsculpt.render.frame.render_frame import ShutterInterval
from flowsculpt.render.mitsuba.engine import Engine
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene import MotionSample
from flowsculpt.render.scene.scene_stage import StagePlacement
from flowsculpt.render.scene.surface import Surface

Rendered = Callable[..., RenderedFrame]

CAMERA = Camera((3.2, 2.9, 8.8), (0.0, 0.95, 0.0))
FINE = Quality(32, 18, samples=48, depth=3, auxiliary_samples=16)
EXTRA = ("velocity", "noise", "samples")


class EndedError(Exception):
    """Raised to end a picture early."""


def always() -> bool:
    return True


def kept(folder: Path, **changes: Any) -> Checkpoint:
    """One that is written after every pass."""
    return Checkpoint(folder / "half" / "a.npz", folder / "draft", **{"urgent": always, **changes})


def unhurried(folder: Path, **changes: Any) -> Checkpoint:
    return Checkpoint(folder / "half" / "a.npz", folder / "draft", **changes)


def same(one: RenderedFrame, other: RenderedFrame) -> bool:
    return one.facts == other.facts and all(np.array_equal(one[name], other[name]) for name in one.arrays)


def ended_after(passes: int) -> Callable[[int, int], None]:
    def on_batch(done: int, most: int) -> None:
        if done == passes:
            raise EndedError

    return on_batch


def sliding(surface: Surface) -> ShutterInterval:
    def at(offset: float) -> MotionSample:
        moved = (surface.vertices + offset * 0.3 * CAMERA.axes()[0]).astype(np.float32)
        return MotionSample(replace(surface, vertices=moved), StagePlacement(), CAMERA)

    return ShutterInterval(-0.25, 0.25, at)


@pytest.mark.parametrize(
    ("blurred", "threshold"),
    [(False, None), (False, 0.04), (True, 0.04)],
    ids=["still", "adaptive", "adaptive, blurred"],
)
def test_a_picture_ended_after_any_pass_goes_on_to_the_same_bits(
    rendered: Rendered, sphere: Surface, tmp_path: Path, blurred: bool, threshold: float | None
) -> None:
    quality = replace(FINE, noise_threshold=threshold)
    marked = replace(sphere, attributes={"velocity": sphere.vertices})
    told: list[int] = []
    picture: dict[str, Any] = {"surface": marked, "aovs": EXTRA, "quality": quality}
    picture["shutter"] = sliding(marked) if blurred else None
    whole = rendered(on_batch=lambda done, most: told.append(most), **picture)
    assert len(told) > 3
    for passes in (2, len(told)):
        with pytest.raises(EndedError):
            rendered(checkpoint=kept(tmp_path), on_batch=ended_after(passes), **picture)
        left: list[int] = []
        again = rendered(
            checkpoint=kept(tmp_path), on_batch=lambda done, most, left=left: left.append(done), **picture
        )
        assert left == list(range(passes + 1, len(told) + 1))
        assert same(whole, again)
        kept(tmp_path).remove()


def test_light_of_fireflies_is_spread_alike_with_one_thread_and_after_an_interruption(
    rendered: Rendered, engine: Engine, tmp_path: Path
) -> None:
    picture: dict[str, Any] = {"look": render.LOOKS["glass"], "quality": replace(FINE, depth=10)}
    whole = rendered(**picture)
    assert whole.facts["light_spread"] > 0.001
    with pytest.raises(EndedError):
        rendered(checkpoint=kept(tmp_path), on_batch=ended_after(2), **picture)
    assert same(whole, rendered(checkpoint=kept(tmp_path), **picture))
    alone = rendered(engine=replace(engine, threads=1), **picture)
    engine.start()
    assert same(whole, alone)


def test_a_quiet_picture_that_was_ended_is_not_rendered_on(rendered: Rendered, tmp_path: Path) -> None:
    quality = replace(FINE, noise_threshold=0.5)
    whole = rendered(quality=quality, checkpoint=kept(tmp_path))
    assert whole.facts["samples"] < 48
    again = rendered(
        quality=quality, checkpoint=kept(tmp_path), on_batch=lambda *_: pytest.fail("rendered on")
    )
    assert same(whole, again)


def test_pictures_that_are_done_before_one_is_due_are_never_written(
    rendered: Rendered, tmp_path: Path
) -> None:
    rendered(quality=FINE, checkpoint=unhurried(tmp_path, seconds=3600.0))
    assert not list(tmp_path.iterdir())


def test_a_process_about_to_end_keeps_what_it_has(rendered: Rendered, tmp_path: Path) -> None:
    rendered(quality=FINE, checkpoint=kept(tmp_path))
    assert [path.name for path in tmp_path.iterdir()] == ["half"]


def test_writing_takes_a_fiftieth_of_the_time_at_most(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now, written = 100.0, list[float]()
    monkeypatch.setattr(checkpoint, "time", SimpleNamespace(monotonic=lambda: now))
    keep = unhurried(tmp_path, seconds=0.0)

    def state() -> dict[str, np.ndarray]:
        nonlocal now
        written.append(now)
        now += 1.0
        return {"done": np.array(1)}

    while now < 300.0:
        keep.save_if_due(state)
        now += 0.25
    assert written == [100.0, 151.0, 202.0, 253.0]


def test_a_corrupt_file_is_told_of_once_and_removed(tmp_path: Path) -> None:
    told: list[str] = []
    keep = kept(tmp_path, warn=told.append)
    keep.save_if_due(lambda: {"done": np.array(3), "sum:beauty": np.random.default_rng(1).random((9, 16, 3))})
    sound = keep.load()
    assert sound is not None and int(sound["done"]) == 3
    data = keep.path.read_bytes()
    middle = len(data) // 2
    flipped = data[:middle] + bytes([data[middle] ^ 255]) + data[middle + 1 :]
    for count, spoilt in enumerate((data[:middle], flipped, b"", b"half done"), start=1):
        keep.path.write_bytes(spoilt)
        assert keep.load() is None and keep.load() is None
        assert len(told) == count and "rendered from the start" in told[-1]
        assert not keep.path.exists()


def test_a_disk_that_refuses_is_told_of_once_and_fails_no_picture(rendered: Rendered, tmp_path: Path) -> None:
    told: list[str] = []
    (tmp_path / "half").write_text("a file stands where the folder should be")
    keep = kept(tmp_path, warn=told.append)
    assert same(rendered(quality=FINE, checkpoint=keep), rendered(quality=FINE))
    assert len(told) == 1 and "starts again" in told[0]
    assert [path.name for path in tmp_path.iterdir()] == ["half"]


_ANOTHER_PROCESS = """
import sys
from pathlib import Path
import numpy as np
from flowsculpt import render
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.frame.checkpoint import Checkpoint
from flowsculpt.render.mitsuba.engine import choose
from flowsculpt.render.frame.render_frame import render_frame
from flowsculpt.render.scene.scene_lights import LIGHTS
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene import Scene
from flowsculpt.render.scene.scene_stage import STAGES, StagePlacement
from flowsculpt.render.scene.surface import Surface

arrays = np.load(sys.argv[1])
surface = Surface(arrays["vertices"], arrays["normals"], arrays["faces"])
camera = Camera((3.2, 2.9, 8.8), (0.0, 0.95, 0.0))
render_frame(
    Scene(surface, LOOKS["clay"], LIGHTS["studio"], STAGES["cyclorama"], StagePlacement(), camera),
    Quality(32, 18, 1_600_000, depth=3, auxiliary_samples=16), 7,
    choose([sys.argv[2]], threads=1),
    checkpoint=Checkpoint(Path(sys.argv[3]), Path(sys.argv[4]), urgent=lambda: True),
)
"""


def test_a_process_that_is_killed_leaves_what_another_goes_on_from(
    rendered: Rendered, sphere: Surface, engine: Engine, tmp_path: Path
) -> None:
    """The checkpoint equals, to the bit, a picture of as many samples."""
    quality = replace(FINE, samples=1_600_000)
    arrays, keep = tmp_path / "in.npz", kept(tmp_path)
    np.savez(arrays, vertices=sphere.vertices, normals=sphere.normals, faces=sphere.faces)
    words = [str(arrays), engine.variant, str(keep.path), str(keep.draft)]
    home = Path(render.__file__).parent.parent
    process = subprocess.Popen([sys.executable, "-c", _ANOTHER_PROCESS, *words], cwd=home)
    limit = time.monotonic() + 300
    while not (state := kept(tmp_path).load()) or int(state["done"]) < 4:
        assert time.monotonic() < limit and process.poll() is None
        time.sleep(0.01)
    process.kill()
    process.wait()
    state = keep.load()
    assert state is not None
    done = int(state["done"])
    assert 4 <= done < 100_000
    fewer = replace(quality, samples=16 * (done + 1))
    again = rendered(quality=fewer, checkpoint=keep)
    assert same(again, rendered(quality=fewer))
