"""Panels with the measures of a shot over its frames, as the review page shows them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.production.stages import STAGES
from render.graphics.plot import Curves, HeatMap, Panel, StackedBars

Measured = Mapping[int, Mapping[str, Any]]

BEYOND = 1.6
"""The axis of seconds ends at this multiple of the 90th percentile, for first frames compile kernels."""


def panels(
    numbers: Sequence[int],
    measured: Measured,
    limits: tuple[float | None, float | None],
    seconds: Mapping[str, Mapping[int, float]],
) -> list[Panel]:
    """Return the panels of a shot.

    measured  by frame, from `measures.measured`
    limits    minimum and maximum edge length, if they are numbers
    seconds   by stage and frame
    """
    frames = np.array(numbers, np.float64)
    rows = [measured.get(number, {}) for number in numbers]
    return [*_of_meshes(frames, rows, limits), *_of_seconds(frames, numbers, seconds)]


def _of_meshes(
    frames: NDArray[np.float64],
    rows: Sequence[Mapping[str, Any]],
    limits: tuple[float | None, float | None],
) -> Iterator[Panel]:
    def values(*names: str) -> NDArray[np.float64]:
        return np.array([[_number(row.get(name)) for name in names] for row in rows])

    none = np.zeros((0, 2))
    if _has(vertices := values("vertices")):
        yield Curves("vertices", "", frames, vertices, none)
    if _has(changes := values("splits", "collapses")):
        yield StackedBars(
            "splits and collapses", "a frame", frames, {"splits": changes[:, 0], "collapses": -changes[:, 1]}
        )
    if (top := next((row["edge_top"] for row in rows if row.get("edge_top")), None)) is not None:
        levels = [(value, word) for value, word in zip(limits, ("min", "max"), strict=True) if value]
        yield HeatMap(
            "edge lengths", "scene units", frames, _shares(rows, "edges"), float(top), tuple(levels)
        )
    if any(row.get("quality") for row in rows):
        worst = values("worst")[:, 0]
        yield HeatMap(
            "roundness of triangles; the line: a hundredth is below",
            "1: equilateral",
            frames,
            _shares(rows, "quality"),
            1.0,
            line=worst,
        )
    if _has(area := values("area")):
        yield Curves("area", "scene units²", frames, area, none)
    if _has(volume := values("volume")):
        yield Curves("volume", "scene units³", frames, volume, none)


def _of_seconds(
    frames: NDArray[np.float64], numbers: Sequence[int], seconds: Mapping[str, Mapping[int, float]]
) -> Iterator[Panel]:
    told = {
        stage: np.array([seconds[stage].get(n, 0.0) for n in numbers]) for stage in STAGES if stage in seconds
    }
    if not told:
        return
    whole = np.sum(list(told.values()), axis=0)
    most = BEYOND * float(np.quantile(whole, 0.9))
    share = np.minimum(1.0, most / np.maximum(whole, 1e-9)) if most else 1.0
    cut = " (the longest cut short)" if most and (whole > most).any() else ""
    yield StackedBars(
        "seconds a frame",
        f"s{cut}",
        frames,
        {STAGES[stage].doing: values * share for stage, values in told.items()},
    )


def _number(value: object) -> float:
    return float(value) if isinstance(value, (int, float)) else np.nan


def _has(values: NDArray[np.float64]) -> bool:
    return bool(np.isfinite(values).any())


def _shares(rows: Sequence[Mapping[str, Any]], name: str) -> NDArray[np.float64]:
    """Return histograms (T, B); zeros for frames without one."""
    bins = next(len(row[name]) for row in rows if row.get(name))
    return np.array([row.get(name) or [0.0] * bins for row in rows], np.float64)
