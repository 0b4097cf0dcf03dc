"""Temporal denoising: average each pixel with its point's earlier and later pixels, by exact motion vectors.

What a denoiser leaves differs from frame to frame and shows as boiling. Each pixel is reprojected to the
neighbouring frames. The light there is averaged in where it shows the same point (by position and coverage)
in the same light (by the noise that is left). Points that just came into view, or are lit otherwise, keep
their own light. The motion is not estimated from pictures: the flow gives it exactly.

After Nehab et al., *Accelerating real-time shading with reverse reprojection caching* (2007), with frames on
both sides.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from render.base.kernel_cache import compiled
from render.scene.camera import Camera
from render.scene.projection import pixel_places
from render.scene.stage import StagePlacement

Floats = NDArray[np.float32]

POSITION_TOLERANCE = 2.5
"""Pixels by which a reprojected point may lie beside the expected one."""

NOISE_LEFT = 0.5
"""Noise that may be left after denoising, as a fraction of what was removed."""

MIN_SPREAD = 0.004
"""The share of a light below which a difference is never taken for a change."""


MOST_SHARE = 3.0
"""Most of what denoising may have changed of a pixel, over the mean around it, to count as noise."""


@dataclass(frozen=True, eq=False)
class DenoisedFrame:
    """A denoised frame, and what temporal denoising needs to know of its pixels.

    light      float32 (H, W, channels), denoised: the beauty, and other light of which it is the sum
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


def removed_noise(beauty: Floats, denoised: Floats, radius: int = 3) -> Floats:
    """Return what denoising changed (H, W), as a share of the light: its root mean square in a square.

    The share of a pixel counts at most MOST_SHARE times that of its neighbours, so that one bright pixel, or
    one that is not finite, does not make them look noisy.
    """
    light = np.maximum(denoised.max(axis=2), 0.02)
    change = np.nan_to_num(np.abs(beauty - denoised), posinf=0.0, neginf=0.0).max(axis=2)
    share = (change / light).astype(np.float64) ** 2
    capped = np.minimum(share, 1.0)
    area = (2 * radius + 1) ** 2
    others = np.maximum(area * _square_means(capped, radius) - capped, 0.0) / (area - 1)
    share = np.minimum(share, MOST_SHARE**2 * others)
    return np.asarray(np.sqrt(_square_means(share, radius)), dtype=np.float32)


def _square_means(picture: NDArray[np.float64], radius: int) -> NDArray[np.float64]:
    """Return the mean (H, W) over the square around each pixel; border pixels are repeated outwards."""
    side = 2 * radius + 1
    for axis in (0, 1):
        widths = [(radius + 1, radius) if a == axis else (0, 0) for a in (0, 1)]
        sums = np.cumsum(np.pad(picture, widths, mode="edge"), axis=axis)
        upper = np.take(sums, range(side, sums.shape[axis]), axis)
        picture = (upper - np.take(sums, range(sums.shape[axis] - side), axis)) / side
    return np.maximum(picture, 0.0)


def temporal_denoise(
    frames: Mapping[int, DenoisedFrame],
    number: int,
    size: tuple[int, int] | None = None,
    corner: tuple[int, int] = (0, 0),
) -> Floats:
    """Return the light (H, W, channels) of frame `number`, averaged with its neighbours.

    The beauty decides the weights, so light groups still sum to it.

    frames        by frame number: the frame itself, and neighbours without a gap
    size, corner  of a crop: width and height of the whole picture, and the crop's upper left corner; pixels
    """
    frame = frames[number]
    height, width = frame.matte.shape
    size = size or (width, height)
    total = _sums(frame, np.ones((height, width, 1), dtype=np.float32))
    values = np.concatenate([frame.light[..., :3], frame.matte[..., None]], axis=2)
    spread = np.maximum(NOISE_LEFT * frame.noise, np.float32(MIN_SPREAD))
    tolerance = _tolerance(frame, size[0])
    rows, columns = np.mgrid[:height, :width]
    whole = pixel_places(*size)[corner[1] : corner[1] + height, corner[0] : corner[0] + width]
    eyes = frame.camera.projection.eyes(whole[..., 0])
    for step in (-1, 1):
        points, at = frame.position, number
        pixels = np.stack([columns, rows], axis=2).astype(np.float32)
        while at + step in frames:
            points = points + _motion(frames[at], frames[at + step], step, pixels)
            at += step
            neighbour = frames[at]
            pixels = _project(neighbour.camera, points, size, corner, eyes)
            others = _sums(
                neighbour, np.concatenate([neighbour.matte[..., None], neighbour.position], axis=2)
            )
            accumulate(values, *_wrapped(neighbour, others, pixels), points, tolerance, spread, total)
    light = np.concatenate([total[..., :3], total[..., 4:]], axis=2)
    return np.asarray(light / total[..., 3:4])


def _sums(frame: DenoisedFrame, others: Floats) -> Floats:
    """Return the beauty of a frame, other channels (H, W, C), and then its other light."""
    return np.concatenate([frame.light[..., :3], others, frame.light[..., 3:]], axis=2)


def _motion(start: DenoisedFrame, end: DenoisedFrame, step: int, pixels: Floats) -> Floats:
    """Return the motion (H, W, 3) to the next frame of the points at `pixels`: by the flow for the subject,
    by the stage for the rest."""
    flow = start.after if step > 0 else start.before
    stage = start.placement.moved(start.position, end.placement) - start.position
    is_subject = (start.matte > 0.5)[..., None]
    motion = np.where(is_subject, flow / np.maximum(start.matte, np.float32(0.5))[..., None], stage)
    motion = np.ascontiguousarray(motion, dtype=np.float32)
    sampled = np.empty((*pixels.shape[:2], 3), dtype=np.float32)
    sample_bilinear(*_wrapped(start, motion, pixels), sampled)
    return sampled


def _wrapped(frame: DenoisedFrame, picture: Floats, pixels: Floats) -> tuple[Floats, Floats]:
    """Return a picture (H, W, C) of a frame, and pixels (H, W, 2) of it, to interpolate across its seam.

    A picture that wraps gets its last column before its first, and its first after its last.
    """
    if not frame.camera.projection.wraps:
        return picture, pixels
    moved = pixels + np.array([1.0, 0.0], dtype=np.float32)
    return np.pad(picture, ((0, 0), (1, 1), (0, 0)), mode="wrap"), moved


def _project(
    camera: Camera, points: Floats, size: tuple[int, int], corner: tuple[int, int], eyes: NDArray[np.float64]
) -> Floats:
    """Return column and row (H, W, 2) of points (H, W, 3) in the camera; −1 for points it does not show.

    eyes  (H, W), those of a stereo camera to which the pixels belong
    """
    width, height = size
    x, y, depth = camera.project(points.reshape(-1, 3), width / height, eyes.ravel()).T
    column = (x + 1.0) / 2.0 * width - 0.5 - corner[0]
    row = (1.0 - y) / 2.0 * height - 0.5 - corner[1]
    if camera.projection.wraps:  # the pole is within the first and the last row
        row = np.clip(row, 0.0, height - 1.0)
    pixels = np.where(depth[:, None] > camera.near, np.stack([column, row], axis=1), -1.0)
    return np.ascontiguousarray(pixels.reshape(*points.shape[:2], 2), dtype=np.float32)


def _tolerance(frame: DenoisedFrame, width: int) -> Floats:
    """Return POSITION_TOLERANCE in scene units (H, W): up to five times as much on grazing surfaces."""
    away = frame.position - np.asarray(frame.camera.origin)
    distance = np.linalg.norm(away, axis=2)
    pixel = np.float64(frame.camera.pixel_size(width)) * distance
    facing = np.abs((away * frame.normal).sum(axis=2)) / np.maximum(distance, 1e-12)
    return np.asarray(POSITION_TOLERANCE * pixel / np.clip(facing, 0.2, 1.0), dtype=np.float32)


@compiled()
def accumulate(
    frame: Floats,
    neighbour: Floats,
    pixels: Floats,
    points: Floats,
    tolerance: Floats,
    spread: Floats,
    total: Floats,
) -> None:
    """Add a neighbour's light to `total` where it shows the same points in the same light.

    frame      (H, W, 4): beauty and matte of the frame
    neighbour  (R, Q, 7 + C): beauty, matte, position and C channels of other light of the other frame
    pixels     (H, W, 2): column and row of each pixel's point in `neighbour`; pixel centres are whole
    points     (H, W, 3): the position of that point then
    tolerance  (H, W): distance between that position and the one found
    spread     (H, W): standard deviation of the light, as a share of it
    total      (H, W, 4 + C): beauty times weight, the weight, and other light times weight
    """
    height, width = frame.shape[:2]
    last_row, last_column = neighbour.shape[0] - 1.0, neighbour.shape[1] - 1.0
    values = np.zeros(neighbour.shape[2])
    for y in range(height):
        for x in range(width):
            column, row = pixels[y, x, 0], pixels[y, x, 1]
            if not (0.0 <= column <= last_column and 0.0 <= row <= last_row):
                continue
            _sample(neighbour, column, row, values)
            if abs(values[3] - frame[y, x, 3]) > 0.1:
                continue
            distance = 0.0
            for axis in range(3):
                distance += (values[4 + axis] - points[y, x, axis]) ** 2
            if not distance <= tolerance[y, x] ** 2:
                continue
            difference, light = 0.0, 0.02
            for channel in range(3):
                difference = max(difference, abs(values[channel] - frame[y, x, channel]))
                light = max(light, max(values[channel], frame[y, x, channel]))
            weight = math.exp(-0.5 * (difference / (light * spread[y, x])) ** 2)
            for channel in range(3):
                total[y, x, channel] += weight * values[channel]
            total[y, x, 3] += weight
            for channel in range(7, values.size):
                total[y, x, channel - 3] += weight * values[channel]


@compiled()
def sample_bilinear(picture: Floats, pixels: Floats, sampled: Floats) -> None:
    """Sample `picture` (H, W, C) at columns and rows `pixels` (H, W, 2) into `sampled` (H, W, C)."""
    height, width = picture.shape[:2]
    values = np.zeros(picture.shape[2])
    for y in range(pixels.shape[0]):
        for x in range(pixels.shape[1]):
            column = min(max(pixels[y, x, 0], 0.0), width - 1.0)
            row = min(max(pixels[y, x, 1], 0.0), height - 1.0)
            _sample(picture, column, row, values)
            sampled[y, x, :] = values


@compiled()
def _sample(picture: Floats, column: float, row: float, values: NDArray[np.float64]) -> None:
    """Interpolate between four pixels, bilinearly."""
    left, top = int(column), int(row)
    right, bottom = min(left + 1, picture.shape[1] - 1), min(top + 1, picture.shape[0] - 1)
    u, v = column - left, row - top
    for channel in range(picture.shape[2]):
        upper = picture[top, left, channel] * (1.0 - u) + picture[top, right, channel] * u
        lower = picture[bottom, left, channel] * (1.0 - u) + picture[bottom, right, channel] * u
        values[channel] = upper * (1.0 - v) + lower * v
