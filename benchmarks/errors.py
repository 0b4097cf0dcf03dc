"""Errors of a picture against a reference, in display values; and pictures side by side."""

from __future__ import annotations

import importlib
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from benchmarks.peers import found
from benchmarks.report import OUT
from flowsculpt.pipeline.arrays import AnyArray
from flowsculpt.render.post.colour import quantise, to_display
from flowsculpt.render.post.image import write_png


def shown(light: AnyArray) -> AnyArray:
    """Convert linear light (H, W, 3) to display values, 0 … 1, not rounded."""
    return np.asarray(to_display(light.astype(np.float32), display="srgb"), dtype=np.float64)


def psnr(light: AnyArray, truth: AnyArray) -> float:
    """Return the peak signal-to-noise ratio of display values, dB."""
    return -10.0 * math.log10(float(((shown(light) - shown(truth)) ** 2).mean()))


def flip(light: AnyArray, truth: AnyArray) -> float | None:
    """Return mean FLIP (Andersson et al. 2020), 0 where no difference is visible; None if it is missing.

    The viewing conditions are FLIP's defaults: a display 0.7 m wide at a distance of 0.7 m.
    """
    if not found("flip_evaluator"):
        return None
    evaluate = importlib.import_module("flip_evaluator").evaluate
    two = [shown(each).astype(np.float32) for each in (truth, light)]
    return float(evaluate(*two, "LDR", applyMagma=False)[1])


def put(name: str, pictures: Mapping[str, AnyArray]) -> Path:
    """Write pictures (H, W, 3) of linear light side by side to `benchmarks/out/<name>.png`."""
    OUT.mkdir(exist_ok=True)
    row = np.concatenate([shown(each) for each in pictures.values()], axis=1).astype(np.float32)
    path = OUT / f"{name}.png"
    write_png(path, quantise(row), {"pictures": ", ".join(pictures)})
    return path
