"""Progress within frames, and what is said of slow ones."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import flowsculpt.pipeline.animation.loop as module
from flowsculpt.pipeline.animation import FrameProgress, animate
from flowsculpt.pipeline.animation.motion_forecast import MotionForecast
from flowsculpt.pipeline.flow import Streamlines, streamlines
from flowsculpt.pipeline.flow.catalogue.vortices import Vortex
from flowsculpt.pipeline.long_computations import Progress
from flowsculpt.pipeline.plugins.fields.curl_noise import CurlNoise
from flowsculpt.pipeline.shot import read_shot
from flowsculpt.pipeline.shot.shot import Shot
from flowsculpt.render.base.kernel_cache import release_after, reserve_kernel

TURBULENT = """
title: Turbulence on a small scale
frames: 1-4
subject: {{solid: icosphere, radius: 4}}
resample: {{max_edge_length: 0.6}}
flows: [{{twist: {{amount: 3}}}}, {{{flow}}}]
look: clay
"""


SPINNING = "rotation: {speed: 90000}"
"""Many sub-steps, and no edge that grows longer."""


def shot_of(folder: Path, flow: str, more: str = "") -> Shot:
    path = folder / "turbulence.yaml"
    path.write_text(TURBULENT.format(flow=flow) + more)
    return read_shot(path)


def curl_noise(folder: Path, settings: str = "strength: 60") -> Shot:
    return shot_of(folder, f"curl_noise: {{{settings}}}")


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have everything that takes over a few milliseconds called slow."""
    monkeypatch.setattr(streamlines, "CALL_SECONDS", 0.002)
    monkeypatch.setattr(module, "SLOW_SECONDS", 0.01)
    monkeypatch.setattr(module, "REPORT_SECONDS", 0.0)


def test_calls_of_any_size_move_points_to_the_same_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    points = np.random.default_rng(3).normal(size=(5000, 3))
    for flow in (
        Streamlines(CurlNoise(), substeps=3),
        Streamlines(Vortex(strength=9.0), max_step=0.01),
        Streamlines(Vortex(strength=9.0), tolerance=1e-8),
    ):
        whole = flow.displace(points, 0.0, 1 / 24)
        with monkeypatch.context() as patch:
            patch.setattr(streamlines, "CALL_SECONDS", 0.0)
            patch.setattr(streamlines, "FIRST_CALL", 1)
            assert flow.displace(points, 0.0, 1 / 24).tobytes() == whole.tobytes(), flow.name


def test_a_flow_reports_its_points_in_ascending_order_up_to_all(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(streamlines, "CALL_SECONDS", 0.005)
    monkeypatch.setattr(streamlines, "FIRST_CALL", 1)
    reports: list[Progress] = []
    with Progress.reported_to(reports.append):
        Streamlines(CurlNoise(), substeps=100).displace(np.random.default_rng(3).normal(size=(3000, 3)), 0, 1)
    done = [report.done for report in reports]
    assert len(done) > 1 and done == sorted(done) and done[-1] == 3000
    assert {report.activity for report in reports} == {"curl_noise"}


@pytest.mark.usefixtures("impatient")
def test_progress_moves_within_a_frame_and_changes_no_mesh(tmp_path: Path) -> None:
    shot, reports = shot_of(tmp_path, SPINNING), list[FrameProgress]()
    frames = list(animate(shot, progress=reports.append))
    assert [frame.number for frame in frames] == [1, 2, 3, 4]
    for frame, alone in zip(frames, animate(shot), strict=True):
        assert frame.mesh.vertices.tobytes() == alone.mesh.vertices.tobytes()
    for number in (2, 3, 4):
        shares = [report.share for report in reports if report.frame == number]
        assert len(shares) > 1 and shares == sorted(shares) and 0.0 < shares[0] < shares[-1] <= 1.0


@pytest.mark.usefixtures("impatient")
def test_a_slow_frame_says_once_what_it_does_and_which_setting_causes_it(tmp_path: Path) -> None:
    reports: list[FrameProgress] = []
    for _ in animate(shot_of(tmp_path, SPINNING), progress=reports.append):
        pass
    said = [report.slow for report in reports if "flows.1 rotation" in report.slow]
    assert len(said) == 1
    for words in ("sub-steps a frame for each of", "vertices: ", "Lower speed"):
        assert words in said[0]


@pytest.mark.usefixtures("impatient")
def test_what_is_computed_once_for_all_frames_makes_no_frame_slow(tmp_path: Path) -> None:
    reports: list[FrameProgress] = []
    receive = module._FrameWatch(shot_of(tmp_path, SPINNING).motion, 2, None, reports.append, set()).receive
    for done in range(1, 5):
        time.sleep(2.0 * module.SLOW_SECONDS)
        receive(Progress("fitting bunny.off", done, 4, is_once=True))
    assert [report.share for report in reports] == [0.25, 0.5, 0.75, 1.0]
    assert not any(report.slow for report in reports) and reports[0].work == "fitting bunny.off"


def test_the_settings_that_are_named_as_remedies_lower_the_sub_steps(tmp_path: Path) -> None:
    shot = curl_noise(tmp_path)
    points = next(iter(animate(shot))).mesh.vertices
    cost = MotionForecast(shot.motion).costs(2, points)[0]
    assert cost.place == "flows.1" and cost.substeps > 100
    for change in ("size: 2, strength: 60", "strength: 30"):
        changed = MotionForecast(curl_noise(tmp_path, change).motion).costs(2, points)[0]
        assert changed.substeps < 0.6 * cost.substeps


def test_steps_that_edges_limit_are_blamed_on_edges(tmp_path: Path) -> None:
    motion = shot_of(tmp_path, "translation: {rate: [9000, 0, 0]}", "max_step: 0.5").motion
    cost = MotionForecast(motion).costs(2, next(iter(animate(motion))).mesh.vertices)[0]
    assert cost.length > cost.gradient
    assert "max_step × max_edge_length" in str(cost) and "raise resample.max_edge_length" in str(cost).lower()


def test_steps_that_a_narrow_vortex_limits_are_blamed_on_it(tmp_path: Path) -> None:
    swept = "sum: [{translation: {rate: [900, 0, 0]}}, {vortex: {radius: 0.1, strength: 0.01}}]"
    motion = shot_of(tmp_path, swept).motion
    points = next(iter(animate(motion))).mesh.vertices
    cost = MotionForecast(motion).costs(2, points)[0]
    assert cost.length > cost.gradient and cost.max_step == pytest.approx(0.05)
    assert "half the size of its smallest detail" in str(cost) and "Raise radius" in str(cost)
    coarser = shot_of(tmp_path, swept, f"max_step: {cost.coarser}").motion
    eased = MotionForecast(coarser).costs(2, points)[0]
    assert eased.substeps == pytest.approx(50, rel=0.1)


def test_a_frame_in_which_kernels_are_compiled_is_not_called_slow(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kernel = Path("module-0123/kernel-4567.kernel")
    monkeypatch.setattr(module, "SLOW_SECONDS", 1.0)
    monkeypatch.setattr(module, "MEASURED_SECONDS", 0.5)
    monkeypatch.setattr(module, "REPORT_SECONDS", 0.0)
    motion = curl_noise(tmp_path).motion

    @release_after
    def take_long(is_compiled: bool) -> None:
        if is_compiled:
            reserve_kernel(kernel)
        time.sleep(1.2)

    def said(is_compiled: bool) -> str:
        heard: list[str] = []
        watch = module._FrameWatch(motion, 1, None, lambda progress: heard.append(progress.slow), set())
        take_long(is_compiled)
        watch.receive(Progress("splitting edges", 5000, 0))
        return "".join(heard)

    assert said(True) == "" and "has taken 1 s so far" in said(False)


def test_maps_have_no_sub_steps(tmp_path: Path) -> None:
    assert MotionForecast(shot_of(tmp_path, "bend: {amount: 3}").motion).costs(2, np.zeros((9, 3))) == []


@pytest.mark.slow
def test_an_interrupt_ends_a_frame_that_would_take_half_an_hour(tmp_path: Path) -> None:
    curl_noise(tmp_path, "strength: 1000, size: 5")
    shot = tmp_path / "turbulence.yaml"
    shot.write_text(shot.read_text().replace("max_edge_length: 0.6", "max_edge_length: 0.1"))
    code = (
        "import sys; from flowsculpt.api.frames import animate; from flowsculpt.api.shots import read_shot\n"
        "print('begins', flush=True)\n"
        "for frame in animate(read_shot(sys.argv[1])): print(frame.number, flush=True)\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code, str(shot)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(Path.cwd())},
    )
    assert process.stdout is not None
    try:
        while process.stdout.readline() != b"1\n":
            assert process.poll() is None
        time.sleep(1.0)
        process.send_signal(signal.SIGINT)
        frames, complaint = process.communicate(timeout=300)
    finally:
        process.kill()
        process.wait()
    assert b"KeyboardInterrupt" in complaint and not frames, "the second frame was never done"
