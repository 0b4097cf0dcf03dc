"""Denoise one frame with Intel's Open Image Denoise, guided by albedo and normals."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.base.render_errors import MachineError
from render.scene.aovs import RenderedFrame

Pixels = NDArray[np.float32]

MOST_MB = 500
"""Most working memory of the denoiser. Larger pictures are denoised in parts that overlap, to the same bits:
1920 × 1080 pixels take 370 MB less than with 900 here, and half as much CPU time again."""


@dataclass(frozen=True)
class Features:
    """Features of a frame without noise, (H, W, 3) each."""

    albedo: Pixels
    normal: Pixels


def denoise(frame: RenderedFrame, effort: str = "high") -> Pixels:
    """Return the denoised beauty, float32 (H, W, 3), of a frame with the AOVs beauty, albedo and normal.

    effort  a Quality's `denoise`: "balanced" takes half the time of "high" and looks alike at small sizes

    Raises MachineError where the denoiser cannot run.
    """
    return denoise_light(frame["beauty"], denoiser_features(frame, effort), effort)


def denoiser_features(frame: RenderedFrame, effort: str = "high") -> Features:
    """Return the features of a frame that guide the denoiser of its light.

    Mirrors and glass show other surfaces, whose features are followed (`denoise_albedo`). Features of a
    pinhole camera are noisy only at edges, and as they are they keep creases crisp. A lens, several motion
    samples, mirrors that are not quite smooth and glass, which mirrors and refracts by chance, make noise. It
    is filtered first: the denoiser would take it for a pattern of the surface. So are the features of smoke,
    whose samples are not those of the light: at edges the two differ.
    Raises MachineError where the denoiser cannot run.
    """
    is_followed = "denoise_albedo" in frame.arrays
    albedo = frame["denoise_albedo" if is_followed else "albedo"]
    normal = frame["denoise_normal" if is_followed else "normal"]
    # A frame that was read has its file's header as facts, where `shutter` is None without motion blur.
    facts = frame.facts
    is_noisy = facts.get("lens_radius", 0.0) > 0.0 or facts.get("motion_samples", 1) > 1
    if is_noisy or is_followed or facts.get("features_apart", False):
        albedo = np.clip(_filtered("albedo", effort, albedo=_finite(albedo)), 0.0, 1.0)
        normal = np.clip(_filtered("normal", effort, normal=_finite(normal)), -1.0, 1.0)
    return Features(albedo, normal)


def denoise_light(light: Pixels, features: Features, effort: str = "high") -> Pixels:
    """Return light (H, W, 3) of a frame without noise: its beauty, or one of its light groups.

    Values that are not finite count as 0. Black stays black: in it the denoiser would see the features.
    Raises MachineError where the denoiser cannot run.
    """
    colour = np.maximum(_finite(light), np.float32(0.0))
    if not colour.any():
        return colour
    return _filtered("color", effort, color=colour, albedo=features.albedo, normal=features.normal)


def _finite(picture: Pixels) -> Pixels:
    return np.nan_to_num(picture, posinf=0.0, neginf=0.0)


def _filtered(kind: str, effort: str, **images: Pixels) -> Pixels:
    """Return the image `kind` of `images` (H, W, 3) without noise; the others guide the filter."""
    import pyoidn  # slow to import, and many processes denoise nothing

    given = {name: np.ascontiguousarray(image, dtype=np.float32) for name, image in images.items()}
    given[pyoidn.OIDN_IMAGE_OUTPUT] = clean = np.empty_like(given[kind])
    filter_ = _filter(kind)
    for name, image in given.items():
        filter_.set_image(name, image, pyoidn.OIDN_FORMAT_FLOAT3)
    filter_.set_quality(getattr(pyoidn, f"OIDN_QUALITY_{effort.upper()}"))
    filter_.commit()
    filter_.execute()
    if (reason := _device().get_error()) is not None:
        raise MachineError(f"the denoiser cannot run: {reason}; render with denoise: off")
    return clean


@cache
def _device() -> Any:
    """Return the denoiser's device, one for the process: its filters share their working memory."""
    import pyoidn

    device = pyoidn.Device()
    device.commit()
    return device


@cache
def _filter(kind: str) -> Any:
    """Return the filter of one kind of image. Kept from frame to frame, it saves a tenth of its time."""
    import pyoidn

    filter_ = pyoidn.Filter(_device())
    filter_.set_bool("hdr", kind == "color")
    filter_.set_bool("cleanAux", kind == "color")
    filter_.set_int("maxMemoryMB", MOST_MB)
    return filter_
