"""Noise taken out over time: frames before and after are followed along the exact motion and taken in.

What a denoiser leaves differs from frame to frame, and a film shows it as boiling. Here every pixel asks
where its point of the scene was in the frames around, and takes in the light found there where that is the
same point (by its position and its coverage) in the same light (by what noise is left). What came into view
just now, or is lit otherwise, keeps its own. The motion is not guessed from pictures: the flow says it.

After Nehab et al., *Accelerating real-time shading with reverse reprojection caching* (2007), with frames on
both sides, which a film has and a game has not.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from render.post.kernels.temporal_denoise import fetch_all, take_in
from render.scene.camera import Camera
from render.scene.stage import StagePlacement

Floats = NDArray[np.float32]

REACH = 2.5
"""Pixels by which the point found may be beside the one expected."""

TRUST = 0.5
"""How much of the noise that the denoiser took out may still be in its picture."""

LEAST_SPREAD = 0.004
"""The share of a light that is never taken for a change of it."""


@dataclass(frozen=True, eq=False)
class Moment:
    """A frame, without its noise, and what is known of its points.

    light      float32 (H, W, 3), denoised
    noise      float32 (H, W), the share of the light by which the denoiser changed it, around each pixel
    position   float32 (H, W, 3), scene units
    normal     float32 (H, W, 3)
    matte      float32 (H, W), how much of the pixel the subject covers
    before     float32 (H, W, 3), how far from here what the pixel shows of the subject was a frame earlier,
               scene units
    after      the same a frame later
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


def noise_of(beauty: Floats, denoised: Floats, radius: int = 3) -> Floats:
    """(H, W): root mean square of what denoising changed, as a share of the light, over a square around."""
    light = np.maximum(denoised.max(axis=2), 0.02)
    share = (np.abs(beauty - denoised).max(axis=2) / light).astype(np.float64) ** 2
    side = 2 * radius + 1
    for axis in (0, 1):
        widths = [(radius + 1, radius) if each == axis else (0, 0) for each in (0, 1)]
        sums = np.cumsum(np.pad(share, widths, mode="edge"), axis=axis)
        ahead = np.take(sums, range(side, sums.shape[axis]), axis)
        share = (ahead - np.take(sums, range(sums.shape[axis] - side), axis)) / side
    return np.asarray(np.sqrt(np.maximum(share, 0.0)), dtype=np.float32)


def steady(
    moments: Mapping[int, Moment],
    frame: int,
    size: tuple[int, int] | None = None,
    corner: tuple[int, int] = (0, 0),
) -> Floats:
    """The light (H, W, 3) of a frame with what its neighbours know of it.

    moments       by frame number: `frame` itself, and those before and after that are asked, without a gap
    size, corner  of parts of pictures: width and height of the whole, and where in it the part begins; pixels
    """
    own = moments[frame]
    height, width = own.matte.shape
    size = size or (width, height)
    total = np.ones((height, width, 4), dtype=np.float32)
    total[..., :3] = own.light
    here = np.concatenate([own.light, own.matte[..., None]], axis=2)
    spread = np.maximum(TRUST * own.noise, np.float32(LEAST_SPREAD))
    reach = _reach(own, size[0])
    for step in (-1, 1):
        arrivals, at = own.position, frame
        places = _pixels(width, height)
        while at + step in moments:
            arrivals = arrivals + _moved(moments[at], moments[at + step], step, places)
            at += step
            places = _seen(moments[at].camera, arrivals, size, corner)
            there = np.concatenate(
                [moments[at].light, moments[at].matte[..., None], moments[at].position], axis=2
            )
            take_in(here, there, places, arrivals, reach, spread, total)
    return np.asarray(total[..., :3] / total[..., 3:])


def _moved(at: Moment, to: Moment, step: int, places: Floats) -> Floats:
    """(H, W, 3): how far the points at `places` of one frame go until the next: the subject's with the flow,
    the others with the stage."""
    flow = at.after if step > 0 else at.before
    stage = at.placement.moved(at.position, to.placement) - at.position
    of_subject = (at.matte > 0.5)[..., None]
    motion = np.where(of_subject, flow / np.maximum(at.matte, np.float32(0.5))[..., None], stage)
    motion = np.ascontiguousarray(motion, dtype=np.float32)
    found = np.empty((*places.shape[:2], 3), dtype=np.float32)
    fetch_all(motion, places, found)
    return found


def _seen(camera: Camera, points: Floats, size: tuple[int, int], corner: tuple[int, int]) -> Floats:
    """(H, W, 2): column and row at which the camera sees points (H, W, 3); what is behind it, nowhere."""
    width, height = size
    x, y, depth = camera.project(points.reshape(-1, 3), width / height).T
    column = (x + 1.0) / 2.0 * width - 0.5 - corner[0]
    row = (1.0 - y) / 2.0 * height - 0.5 - corner[1]
    places = np.where(depth[:, None] > camera.near, np.stack([column, row], axis=1), -1.0)
    return np.ascontiguousarray(places.reshape(*points.shape[:2], 2), dtype=np.float32)


def _pixels(width: int, height: int) -> Floats:
    rows, columns = np.mgrid[:height, :width]
    return np.stack([columns, rows], axis=2).astype(np.float32)


def _reach(own: Moment, width: int) -> Floats:
    """(H, W): REACH pixels where a surface faces the lens, up to five times as much where it turns away."""
    away = own.position - np.asarray(own.camera.origin)
    distance = np.linalg.norm(away, axis=2)
    pixel = 2.0 * np.tan(own.camera.field_of_view / 2.0) / width * distance
    facing = np.abs((away * own.normal).sum(axis=2)) / np.maximum(distance, 1e-12)
    return np.asarray(REACH * pixel / np.clip(facing, 0.2, 1.0), dtype=np.float32)
