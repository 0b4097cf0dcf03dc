"""Denoise one frame with Intel's Open Image Denoise, guided by albedo and normals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from render.base.errors import MachineError
from render.scene.aovs import RenderedFrame

Pixels = NDArray[np.float32]


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
    pinhole camera are noisy only at edges, and as they are they keep creases crisp. A lens, an open shutter
    and a mirror that is not quite smooth make noise, which is filtered first. The albedo seen through glass
    stays as it is: filtered, it would lose what glass shows small.
    Raises MachineError where the denoiser cannot run.
    """
    is_followed = "denoise_albedo" in frame.arrays
    albedo = frame["denoise_albedo" if is_followed else "albedo"]
    normal = frame["denoise_normal" if is_followed else "normal"]
    is_noisy = bool(frame.facts.get("lens_radius", 0.0)) or "shutter" in frame.facts
    if is_noisy or (is_followed and not frame.facts.get("is_clear", False)):
        albedo = np.clip(_filtered(albedo, "albedo", effort), 0.0, 1.0)
    if is_noisy or is_followed:
        normal = np.clip(_filtered(normal, "normal", effort), -1.0, 1.0)
    return Features(albedo, normal)


def denoise_light(light: Pixels, features: Features, effort: str = "high") -> Pixels:
    """Return light (H, W, 3) of a frame without noise: its beauty, or one of its light groups.

    Values that are not finite count as 0. Black stays black: in it the denoiser would see the features.
    Raises MachineError where the denoiser cannot run.
    """
    import pyoidn  # slow to import, and many processes denoise nothing

    colour = np.maximum(np.nan_to_num(light, posinf=0.0, neginf=0.0), np.float32(0.0))
    if not colour.any():
        return colour
    guides = {"albedo": features.albedo, "normal": features.normal}
    try:
        clean = pyoidn.denoise(colour, **guides, hdr=True, clean_aux=True, quality=effort)
    except RuntimeError as error:
        raise _cannot_run(error) from None
    return np.asarray(clean, dtype=np.float32)


def _filtered(picture: Pixels, name: str, effort: str) -> Pixels:
    """Return the feature `name` (H, W, 3) without noise, by the denoiser's filter for that feature."""
    import pyoidn

    source = np.ascontiguousarray(np.nan_to_num(picture, posinf=0.0, neginf=0.0), dtype=np.float32)
    clean = np.empty_like(source)
    qualities = {"fast": pyoidn.OIDN_QUALITY_FAST, "balanced": pyoidn.OIDN_QUALITY_BALANCED}
    with pyoidn.Device() as device:
        device.commit()
        with pyoidn.Filter(device) as filter_:
            filter_.set_image(name, source, pyoidn.OIDN_FORMAT_FLOAT3)
            filter_.set_image(pyoidn.OIDN_IMAGE_OUTPUT, clean, pyoidn.OIDN_FORMAT_FLOAT3)
            filter_.set_quality(qualities.get(effort, pyoidn.OIDN_QUALITY_HIGH))
            filter_.commit()
            filter_.execute()
        if (reason := device.get_error()) is not None:
            raise _cannot_run(reason)
    return clean


def _cannot_run(reason: object) -> MachineError:
    return MachineError(f"the denoiser cannot run: {reason}; render with denoise: off")
