"""How far a picture is from the truth, as it is seen on a display; and pictures beside each other."""

from __future__ import annotations

import importlib
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from benchmarks.peers import found
from benchmarks.report import OUT
from pipeline.arrays import AnyArray
from render.post.colour import quantise, to_display
from render.post.image import write_png


def shown(light: AnyArray) -> AnyArray:
    """(H, W, 3) linear light as a display shows it, 0 … 1, not rounded."""
    return np.asarray(to_display(light.astype(np.float32), display="srgb"), dtype=np.float64)


def psnr(light: AnyArray, truth: AnyArray) -> float:
    """Decibels, as seen on a display."""
    return -10.0 * math.log10(float(((shown(light) - shown(truth)) ** 2).mean()))


def flip(light: AnyArray, truth: AnyArray) -> float | None:
    """Mean FLIP (Andersson et al. 2020), 0 for what no eye tells apart; None where it is not installed.

    As seen on a display of 0.7 m at a distance of 0.7 m, which is FLIP's own default.
    """
    if not found("flip_evaluator"):
        return None
    evaluate = importlib.import_module("flip_evaluator").evaluate
    two = [shown(each).astype(np.float32) for each in (truth, light)]
    return float(evaluate(*two, "LDR", applyMagma=False)[1])


def put(name: str, pictures: Mapping[str, AnyArray]) -> Path:
    """Pictures (H, W, 3) of linear light side by side, `benchmarks/out/<name>.png`, to be looked at."""
    OUT.mkdir(exist_ok=True)
    row = np.concatenate([shown(each) for each in pictures.values()], axis=1).astype(np.float32)
    path = OUT / f"{name}.png"
    write_png(path, quantise(row), {"pictures": ", ".join(pictures)})
    return path
