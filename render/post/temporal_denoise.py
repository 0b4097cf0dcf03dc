"""Temporal denoising: average each pixel with its point's earlier and later pixels, by exact motion vectors.

What a denoiser leaves differs from frame to frame and shows as boiling. Each pixel is reprojected to the
neighbouring frames. The light there is averaged in where it shows the same point (by position and coverage)
in the same light (by the noise that is left). Points that just came into view, or are lit otherwise, keep
their own light. The motion is not estimated from pictures: the flow gives it exactly.

After Nehab et al., *Accelerating real-time shading with reverse reprojection caching* (2007), with frames on
both sides.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from render.post.kernels.temporal_denoise import accumulate, sample_bilinear
from render.scene.camera import Camera
from render.scene.stage import StagePlacement

Floats = NDArray[np.float32]

POSITION_TOLERANCE = 2.5
"""Pixels by which a reprojected point may lie beside the expected one."""

NOISE_LEFT = 0.5
"""The share of the noise removed by the denoiser that may still be in its picture."""

MIN_SPREAD = 0.004
"""The share of a light below which a difference is never taken for a change."""


@dataclass(frozen=True, eq=False)
class DenoisedFrame:
    """A denoised frame, and what temporal denoising needs to know of its pixels.

    light      float32 (H, W, 3), denoised
    noise      float32 (H, W), the share of the light that denoising changed, around each pixel
    position   float32 (H, W, 3), scene units
    normal     float32 (H, W, 3)
    matte      float32 (H, W), the subject's coverage
    before     float32 (H, W, 3), the subject's offset to its place one frame earlier, scene units
    after      float32 (H, W, 3), the same to one frame later
    """

    light: Floats
    noise: Floats
    position: Floats
    normal: Floats
    matte: Floats
    before: Floats
    after: Floats
    camera: Camera
    placement: StagePlacement


def residual_noise(beauty: Floats, denoised: Floats, radius: int = 3) -> Floats:
    """Return what denoising changed (H, W), as a share of the light: its root mean square in a square."""
    light = np.maximum(denoised.max(axis=2), 0.02)
    share = (np.abs(beauty - denoised).max(axis=2) / light).astype(np.float64) ** 2
    side = 2 * radius + 1
    for axis in (0, 1):
        widths = [(radius + 1, radius) if a == axis else (0, 0) for a in (0, 1)]
        sums = np.cumsum(np.pad(share, widths, mode="edge"), axis=axis)
        upper = np.take(sums, range(side, sums.shape[axis]), axis)
        share = (upper - np.take(sums, range(sums.shape[axis] - side), axis)) / side
    return np.asarray(np.sqrt(np.maximum(share, 0.0)), dtype=np.float32)


def temporal_denoise(
    frames: Mapping[int, DenoisedFrame],
    number: int,
    size: tuple[int, int] | None = None,
    corner: tuple[int, int] = (0, 0),
) -> Floats:
    """Return the light (H, W, 3) of frame `number`, averaged with its neighbours.

    frames        by frame number: the frame itself, and neighbours without a gap
    size, corner  of a crop: width and height of the whole picture, and the crop's upper left corner; pixels
    """
    frame = frames[number]
    height, width = frame.matte.shape
    size = size or (width, height)
    total = np.ones((height, width, 4), dtype=np.float32)
    total[..., :3] = frame.light
    values = np.concatenate([frame.light, frame.matte[..., None]], axis=2)
    spread = np.maximum(NOISE_LEFT * frame.noise, np.float32(MIN_SPREAD))
    tolerance = _tolerance(frame, size[0])
    for step in (-1, 1):
        points, at = frame.position, number
        pixels = _pixel_grid(width, height)
        while at + step in frames:
            points = points + _motion(frames[at], frames[at + step], step, pixels)
            at += step
            neighbour = frames[at]
            pixels = _project(neighbour.camera, points, size, corner)
            others = np.concatenate([neighbour.light, neighbour.matte[..., None], neighbour.position], axis=2)
            accumulate(values, others, pixels, points, tolerance, spread, total)
    return np.asarray(total[..., :3] / total[..., 3:])


def _motion(start: DenoisedFrame, end: DenoisedFrame, step: int, pixels: Floats) -> Floats:
    """Return the motion (H, W, 3) to the next frame of the points at `pixels`: by the flow for the subject,
    by the stage for the rest."""
    flow = start.after if step > 0 else start.before
    stage = start.placement.moved(start.position, end.placement) - start.position
    is_subject = (start.matte > 0.5)[..., None]
    motion = np.where(is_subject, flow / np.maximum(start.matte, np.float32(0.5))[..., None], stage)
    motion = np.ascontiguousarray(motion, dtype=np.float32)
    sampled = np.empty((*pixels.shape[:2], 3), dtype=np.float32)
    sample_bilinear(motion, pixels, sampled)
    return sampled


def _project(camera: Camera, points: Floats, size: tuple[int, int], corner: tuple[int, int]) -> Floats:
    """Return column and row (H, W, 2) of points (H, W, 3) in the camera; −1 for points behind it."""
    width, height = size
    x, y, depth = camera.project(points.reshape(-1, 3), width / height).T
    column = (x + 1.0) / 2.0 * width - 0.5 - corner[0]
    row = (1.0 - y) / 2.0 * height - 0.5 - corner[1]
    pixels = np.where(depth[:, None] > camera.near, np.stack([column, row], axis=1), -1.0)
    return np.ascontiguousarray(pixels.reshape(*points.shape[:2], 2), dtype=np.float32)


def _pixel_grid(width: int, height: int) -> Floats:
    rows, columns = np.mgrid[:height, :width]
    return np.stack([columns, rows], axis=2).astype(np.float32)


def _tolerance(frame: DenoisedFrame, width: int) -> Floats:
    """Return POSITION_TOLERANCE in scene units (H, W): up to five times as much on grazing surfaces."""
    away = frame.position - np.asarray(frame.camera.origin)
    distance = np.linalg.norm(away, axis=2)
    pixel = 2.0 * np.tan(frame.camera.field_of_view / 2.0) / width * distance
    facing = np.abs((away * frame.normal).sum(axis=2)) / np.maximum(distance, 1e-12)
    return np.asarray(POSITION_TOLERANCE * pixel / np.clip(facing, 0.2, 1.0), dtype=np.float32)
