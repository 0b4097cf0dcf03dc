"""Surfaces and lines from seeds in fields of which memory holds two times at once."""

from __future__ import annotations

import weakref
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flowsculpt import Streamlines, Thresholds
from flowsculpt.api.flows import Sampled
from flowsculpt.pipeline.plugins.streams.released_lines import PathLines, StreakLines
from flowsculpt.pipeline.plugins.streams.released_surfaces import PathSurface, StreakSurface
from flowsculpt.pipeline.plugins.streams.seed_curves import SeedCurve

xarray = pytest.importorskip("xarray")
windowed_samples = pytest.importorskip("flowsculpt.pipeline.plugins.fields.windowed_samples")
cf_files = pytest.importorskip("flowsculpt.pipeline.plugins.fields.cf_files")
chunked_times = pytest.importorskip("flowsculpt.pipeline.plugins.fields.chunked_times")
cf_headers = pytest.importorskip("flowsculpt.pipeline.plugins.fields.cf_headers")
grid_layout = pytest.importorskip("flowsculpt.pipeline.plugins.fields.grid_layout")

LINE = SeedCurve(np.array([[-0.6, 0.1, 0.2], [0.6, 0.1, 0.2]]))
FRAMES, TIMES, LONGEST = 8, 9, 0.3


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a store of a turn whose axis turns, with nine times."""
    path, axis = tmp_path_factory.mktemp("store") / "turn.zarr", np.linspace(-1.5, 1.5, 10)
    t, z, y, x = np.meshgrid(0.4 * np.arange(TIMES), axis, axis, axis, indexing="ij")
    dims, speed = ("time", "z", "y", "x"), {"units": "m s-1"}
    parts = {"u": np.cos(t) * z - y, "v": x + np.sin(t) * z, "w": -np.cos(t) * x - np.sin(t) * y}
    axes = {name: (name, axis, {"units": "m", "axis": name.upper()}) for name in "xyz"}
    data = xarray.Dataset(
        {name: (dims, values.astype("f4"), speed) for name, values in parts.items()},
        {**axes, "time": ("time", np.arange(TIMES), {"units": "seconds since 2020-01-01"})},
    )
    data.to_zarr(path, zarr_format=2, encoding={name: {"chunks": (1, 5, 5, 5)} for name in "uvw"})
    return path


class Held:
    """What is read of samples: how often each time, and how many times are in memory at once at most."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.reads, self.most, self._alive = Counter[int](), 0, list[Any]()
        for name, counts in (("_read", True), ("velocities", False)):
            self._count(monkeypatch, name, counts)

    def _count(self, monkeypatch: pytest.MonkeyPatch, name: str, counts: bool) -> None:
        original = getattr(windowed_samples.WindowedSamples, name)

        def counted(samples: Any, index: int) -> np.ndarray:
            velocity = original(samples, index)
            self.reads[index] += counts
            if all(each() is not velocity for each in self._alive):
                self._alive.append(weakref.ref(velocity))
            self._alive = [each for each in self._alive if each() is not None]
            self.most = max(self.most, len(self._alive))
            return velocity

        monkeypatch.setattr(windowed_samples.WindowedSamples, name, counted)


def grown(kind: Any, store: Path, field: Any = Sampled) -> Any:
    """Return what LINE releases in some frames, of which two pass between two times of the samples."""
    samples, _ = cf_files.cf_samples((store,), cf_headers.Selection(), grid_layout.Placing())
    flow = Streamlines(field(samples, time_scale=12.0, strength=0.25))
    more = (Thresholds(LONGEST),) if kind in (PathSurface, StreakSurface) else (8, LONGEST, 0.02)
    released = kind(LINE, flow, 0.0, *more)
    for frame in range(1, FRAMES + 1):
        released.grow(frame / 24.0)
    return released


@pytest.mark.parametrize("kind", [PathSurface, StreakSurface, PathLines, StreakLines])
def test_a_surface_is_the_same_with_two_times_in_memory_as_with_all(
    store: Path, monkeypatch: pytest.MonkeyPatch, kind: Any
) -> None:
    whole = grown(kind, store).mesh
    monkeypatch.setattr(windowed_samples, "KEPT_BYTES", 0)
    held = Held(monkeypatch)
    mesh = grown(kind, store, chunked_times.SampledByChunk).mesh
    np.testing.assert_array_equal(mesh.vertices, whole.vertices)
    np.testing.assert_array_equal(mesh.faces, whole.faces)
    assert set(held.reads) == set(range(FRAMES // 2 + 1)) and held.most == 2
    assert max(held.reads.values()) <= windowed_samples.ONCE_EACH + 1


def test_steps_end_at_the_times_of_the_samples(store: Path) -> None:
    steps = grown(PathLines, store).travel.steps
    assert {round(12.0 * step.end, 9) for step in steps} >= {1.0, 2.0, 3.0, 4.0}
    back = Streamlines(steps[0].flow.field)
    lines = PathLines(LINE, back, 0.3, 8, 0.5, 0.02)
    lines.grow_back(0.0)
    assert {round(12.0 * step.end, 9) for step in lines.back.steps} >= {3.0, 2.0, 1.0, 0.0}
