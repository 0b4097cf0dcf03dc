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
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.kernel_cache import compiled
from flowsculpt.render.scene.render_camera import Camera, pixel_places
from flowsculpt.render.scene.scene_stage import StagePlacement

Floats = NDArray[np.float32]
Halves = NDArray[np.float16] | NDArray[np.float32]

POSITION_TOLERANCE = 2.5
"""Pixels by which a reprojected point may lie beside the expected one."""

NOISE_LEFT = 0.5
"""Noise that may be left after denoising, as a fraction of the noise removed."""

MIN_SPREAD = 0.004
"""The share of a light below which a difference is never treated as a change."""

MOST_SHARE = 3.0
"""Most of what denoising may have changed of a pixel, over the mean around it, to count as noise."""

BAND = 32
"""Rows that are projected at a time, so that their coordinates stay in the processor's cache."""


@dataclass(frozen=True, eq=False)
class DenoisedFrame:
    """A denoised frame, and what temporal denoising needs to know of its pixels.

    light      float32 (H, W, channels), denoised: the beauty, and other light that sums to it
    noise      float32 (H, W), the share of the light that denoising changed, around each pixel
    position   float32 (H, W, 3), scene units
    normal     float16 or float32 (H, W, 3)
    matte      float16 or float32 (H, W), the subject's coverage
    before     float16 or float32 (H, W, 3), the subject's offset to its place one frame earlier, scene units
    after      float16 or float32 (H, W, 3), the same to one frame later
    """

    light: Floats
    noise: Floats
    position: Floats
    normal: Halves
    matte: Halves
    before: Halves
    after: Halves
    camera: Camera
    placement: StagePlacement

    def without(self, *names: str) -> DenoisedFrame:
        """Return the frame with empty arrays in place of those of these names."""
        nothing: dict[str, Any] = dict.fromkeys(names, _NOTHING)
        return replace(self, **nothing)


_NOTHING = np.empty(0, np.float16)


def removed_noise(beauty: Floats, denoised: Floats, radius: int = 3) -> Floats:
    """Return what denoising changed (H, W), as a share of the light: its root mean square in a square.

    The share of a pixel counts at most MOST_SHARE times that of its neighbours, so that one bright pixel, or
    one that is not finite, does not make them look noisy.
    """
    change = np.abs(np.subtract(beauty, denoised, dtype=np.float32)).max(axis=2)
    np.nan_to_num(change, copy=False, posinf=0.0, neginf=0.0)
    share = (change / np.maximum(denoised.max(axis=2), 0.02)) ** 2
    capped = np.minimum(share, 1.0)
    area = (2 * radius + 1) ** 2
    others = np.maximum(area * square_means(capped, radius) - capped, 0.0) / (area - 1)
    return np.sqrt(square_means(np.minimum(share, MOST_SHARE**2 * others), radius))


@compiled()
def square_means(picture: Floats, radius: int) -> Floats:
    """Return the mean (H, W) over the square around each pixel; border pixels are repeated outwards."""
    height, width = picture.shape
    means = np.empty_like(picture)
    columns = np.zeros(width)  # sums over the rows of the square
    for x in range(width):
        columns[x] = (radius + 1) * picture[0, x]
        for y in range(1, radius + 1):
            columns[x] += picture[min(y, height - 1), x]
    for y in range(height):
        if y > 0:
            for x in range(width):
                columns[x] += picture[min(y + radius, height - 1), x] - picture[max(y - radius - 1, 0), x]
        total = (radius + 1) * columns[0]
        for x in range(1, radius + 1):
            total += columns[min(x, width - 1)]
        for x in range(width):
            if x > 0:
                total += columns[min(x + radius, width - 1)] - columns[max(x - radius - 1, 0)]
            means[y, x] = max(total, 0.0) / (2 * radius + 1) ** 2
    return means


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
    sums = np.pad(frame.light, ((0, 0), (0, 0), (0, 1)), constant_values=1.0)
    matte, tolerance = _floats(frame.matte), _tolerance(frame, size[0])
    spread = np.maximum(NOISE_LEFT * _floats(frame.noise), np.float32(MIN_SPREAD))
    wraps = frame.camera.projection.wraps
    for step in (-1, 1):
        points, at = frame.position.copy(), number
        pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=2).astype(np.float32)
        while at + step in frames:
            start, end = frames[at], frames[at + step]
            flow = _floats(start.after if step > 0 else start.before)
            stage = _stage_motion(start, end)
            follow(start.position, _floats(start.matte), flow, stage, pixels, wraps, points)
            _project(end.camera, points, size, corner, pixels)
            others = end.light, _floats(end.matte), end.position
            accumulate(frame.light, matte, *others, pixels, wraps, points, tolerance, spread, sums)
            at += step
    return np.asarray(sums[..., :-1] / sums[..., -1:])


def _floats(array: Halves) -> Floats:
    return np.ascontiguousarray(array, dtype=np.float32)


def _stage_motion(start: DenoisedFrame, end: DenoisedFrame) -> NDArray[np.float64]:
    """Return the matrix (3, 4) of the stage's motion, by which a position becomes its offset."""
    change = end.placement.matrix() @ np.linalg.inv(start.placement.matrix())
    return np.asarray(change[:3] - np.eye(3, 4))


def _project(
    camera: Camera, points: Floats, size: tuple[int, int], corner: tuple[int, int], pixels: Floats
) -> None:
    """Write column and row of points (H, W, 3) in the camera into `pixels` (H, W, 2); −1 for what it does
    not show. A pixel of a stereo picture stays with its eye."""
    width, height = size
    columns = slice(corner[0], corner[0] + pixels.shape[1])
    eyes = camera.projection.eyes(pixel_places(width, 1)[0, columns, 0])
    for first in range(0, len(points), BAND):
        band = slice(first, first + BAND)
        near = points[band].reshape(-1, 3)
        x, y, depth = camera.project(near, width / height, np.tile(eyes, len(near) // len(eyes))).T
        column = (x + 1.0) / 2.0 * width - 0.5 - corner[0]
        row = (1.0 - y) / 2.0 * height - 0.5 - corner[1]
        if camera.projection.wraps:  # the pole is within the first and the last row
            row = np.clip(row, 0.0, height - 1.0)
        shown = np.where(depth[:, None] > camera.near, np.stack([column, row], axis=1), -1.0)
        pixels[band] = shown.reshape(pixels[band].shape)


def _tolerance(frame: DenoisedFrame, width: int) -> Floats:
    """Return POSITION_TOLERANCE in scene units (H, W): up to five times as much on grazing surfaces."""
    away = frame.position - np.asarray(frame.camera.origin, dtype=np.float32)
    distance = np.sqrt(np.einsum("ijk,ijk->ij", away, away))
    facing = np.abs(np.einsum("ijk,ijk->ij", away, _floats(frame.normal))) / np.maximum(distance, 1e-12)
    pixel = np.float32(POSITION_TOLERANCE * frame.camera.pixel_size(width)) * distance
    return np.asarray(pixel / np.clip(facing, 0.2, 1.0), dtype=np.float32)


@compiled()
def follow(
    position: Floats,
    matte: Floats,
    flow: Floats,
    stage: NDArray[np.float64],
    pixels: Floats,
    wraps: bool,
    points: Floats,
) -> None:
    """Move `points` (H, W, 3), which are at `pixels` (H, W, 2), to where they are one frame later or earlier.

    The subject moves by the flow, and what is not the subject with the stage.

    position  (R, Q, 3) of the frame in which the points are now
    matte     (R, Q), its coverage by the subject
    flow      (R, Q, 3), its subject's offsets times its coverage
    stage     (3, 4): adds to a position its motion with the stage
    """
    height, width = matte.shape
    for y in range(points.shape[0]):
        for x in range(points.shape[1]):
            column, row = pixels[y, x, 0], min(max(pixels[y, x, 1], 0.0), height - 1.0)
            if not wraps:
                column = min(max(column, 0.0), width - 1.0)
            for top, left, weight in _corners(column, row, width, height, wraps):
                if matte[top, left] > 0.5:
                    for axis in range(3):
                        points[y, x, axis] += weight * flow[top, left, axis] / matte[top, left]
                    continue
                for axis in range(3):
                    moved = stage[axis, 3]
                    for other in range(3):
                        moved += stage[axis, other] * position[top, left, other]
                    points[y, x, axis] += weight * moved


@compiled()
def accumulate(
    own: Floats,
    own_matte: Floats,
    light: Floats,
    matte: Floats,
    position: Floats,
    pixels: Floats,
    wraps: bool,
    points: Floats,
    tolerance: Floats,
    spread: Floats,
    sums: Floats,
) -> None:
    """Add a neighbour's light to `sums` where it shows the same points in the same light.

    own        (H, W, C): light of the frame, the beauty first; `own_matte` (H, W) its matte
    light      (R, Q, C): light of the neighbour; `matte` (R, Q) and `position` (R, Q, 3) likewise
    pixels     (H, W, 2): column and row of each pixel's point in the neighbour; pixel centres are whole
    wraps      True if the neighbour's first and last column adjoin
    points     (H, W, 3): the position of that point then
    tolerance  (H, W): distance between that position and the one found
    spread     (H, W): standard deviation of the light, as a share of it
    sums       (H, W, C + 1): light times weight, and the weight
    """
    height, width, channels = light.shape
    beside = 1.0 if wraps else 0.0
    values = np.zeros(channels)
    for y in range(own.shape[0]):
        for x in range(own.shape[1]):
            column, row = pixels[y, x, 0], pixels[y, x, 1]
            if not (-beside <= column <= width - 1.0 + beside and 0.0 <= row <= height - 1.0):
                continue
            corners = _corners(column, row, width, height, wraps)
            coverage = 0.0
            for top, left, weight in corners:
                coverage += weight * matte[top, left]
            if abs(coverage - own_matte[y, x]) > 0.1:
                continue
            distance = 0.0
            for axis in range(3):
                found = 0.0
                for top, left, weight in corners:
                    found += weight * position[top, left, axis]
                distance += (found - points[y, x, axis]) ** 2
            if not distance <= tolerance[y, x] ** 2:
                continue
            for channel in range(channels):
                values[channel] = 0.0
                for top, left, weight in corners:
                    values[channel] += weight * light[top, left, channel]
            difference, brightest = 0.0, 0.02
            for channel in range(3):
                difference = max(difference, abs(values[channel] - own[y, x, channel]))
                brightest = max(brightest, max(values[channel], own[y, x, channel]))
            share = math.exp(-0.5 * (difference / (brightest * spread[y, x])) ** 2)
            for channel in range(channels):
                sums[y, x, channel] += share * values[channel]
            sums[y, x, channels] += share


@compiled()
def _corners(
    column: float, row: float, width: int, height: int, wraps: bool
) -> tuple[tuple[int, int, float], ...]:
    """Return row, column and weight of the four pixels around a place, for bilinear interpolation."""
    left, top = math.floor(column), math.floor(row)
    u, v = column - left, row - top
    right, bottom = left + 1, min(top + 1, height - 1)
    if wraps:
        left, right = left % width, right % width
    else:
        right = min(right, width - 1)
    return (
        (top, left, (1.0 - u) * (1.0 - v)),
        (top, right, u * (1.0 - v)),
        (bottom, left, (1.0 - u) * v),
        (bottom, right, u * v),
    )
