"""The denoiser takes memory that is free, and gives the same bits with less."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from flowsculpt.render.base import work_clock
from flowsculpt.render.post import denoise as denoiser


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
