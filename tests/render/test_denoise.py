"""The denoiser takes memory that is free, and gives the same bits with less."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from flowsculpt.render.base import work_clock
from flowsculpt.render.post import denoise as denoiser
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.scene_stage import StagePlacement


def test_pictures_that_are_denoised_in_parts_have_the_same_bits(monkeypatch: pytest.MonkeyPatch):
    random = np.random.default_rng(1)
    light = random.exponential(size=(270, 480, 3)).astype(np.float32)
    features = denoiser.Features(np.full_like(light, 0.5), np.full_like(light, 0.6))
    pictures = []
    for megabytes in (1, 900):
        denoiser._filter.cache_clear()
        for name in ("LEAST_MB", "MOST_MB"):
            monkeypatch.setattr(denoiser, name, megabytes)
        pictures.append(denoiser.denoise_light(light, features, "fast"))
    denoiser._filter.cache_clear()
    assert np.array_equal(*pictures)


def test_memory_that_a_control_group_limits_is_not_free(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    if not Path("/proc/self/cgroup").exists():
        pytest.skip("this system has no control groups")
    monkeypatch.setattr(work_clock, "CONTROL_GROUPS", tmp_path)
    (tmp_path / "memory.current").write_text("400000\n")
    (tmp_path / "memory.max").write_text("max\n")
    assert work_clock.free_memory() > 1.0
    (tmp_path / "memory.max").write_text("1000000\n")
    assert work_clock.free_memory() == pytest.approx(0.6)


class Shelf(dict[int, np.ndarray]):
    """Light that two denoisers share."""

    def put(self, number: int, light: np.ndarray) -> None:
        self[number] = light


def noisy_frame(number: int) -> denoiser.RawFrame:
    random, flat = np.random.default_rng(number), np.zeros((9, 16, 3), np.float32)
    position = np.stack([*np.meshgrid(np.arange(16.0), np.arange(9.0)), flat[..., 0]], axis=2)
    arrays = {"beauty": random.random(flat.shape).astype(np.float32), "albedo": flat + 0.5}
    arrays |= {"normal": flat + 0.5, "matte": flat[..., 0] + 1.0, "before": flat - 0.1, "after": flat + 0.1}
    layers = RenderedFrame({**arrays, "position": position.astype(np.float32)})
    return denoiser.RawFrame(layers, Camera((0.0, 0.0, 9.0), (0.0, 0.0, 0.0)), StagePlacement())


def test_frames_that_two_batches_average_are_denoised_by_the_first_alone(monkeypatch: pytest.MonkeyPatch):
    denoised = list[int]()
    frames = {number: noisy_frame(number) for number in range(1, 7)}
    single = denoiser.FilmDenoiser._single_light
    monkeypatch.setattr(
        denoiser.FilmDenoiser,
        "_single_light",
        lambda self, raw: (denoised.append(1), single(self, raw))[1],
    )

    def light(batch: range, shared: Shelf | None) -> list[np.ndarray]:
        film = denoiser.FilmDenoiser(frames.__getitem__, "fast", shared=shared)
        return [film.light(n, range(max(1, n - 1), min(6, n + 1) + 1)) for n in batch]

    alone = light(range(1, 7), None)
    assert len(denoised) == 6
    shelf = Shelf()
    assert np.array_equal(light(range(1, 4), shelf) + light(range(4, 7), shelf), alone)
    assert len(denoised) == 12
    shelf = Shelf()
    films = [denoiser.FilmDenoiser(frames.__getitem__, "fast", shared=shelf) for _ in range(3)]
    for number in range(1, 7):  # at the same time, each begins with its own two
        films[(number - 1) // 2].share(number)
    together = [films[(n - 1) // 2].light(n, range(max(1, n - 1), min(6, n + 1) + 1)) for n in range(1, 7)]
    assert np.array_equal(together, alone) and len(denoised) == 18


def test_frames_asked_for_in_any_order_and_with_any_windows_have_the_same_bits():
    def film() -> denoiser.FilmDenoiser:
        return denoiser.FilmDenoiser(noisy_frame, "off")

    asked = [(2, 2), (1, 2), (3, 1), (3, 2), (4, 2), (5, 1), (6, 2), (4, 1)]
    windows = [(number, range(max(1, number - reach), number + reach + 1)) for number, reach in asked]
    one = film()
    for number, window in windows:
        assert np.array_equal(one.light(number, window), film().light(number, window)), number
