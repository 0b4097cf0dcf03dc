"""Denoise one frame with Intel's Open Image Denoise, guided by albedo and normals."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from typing import Any

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
    pinhole camera are noisy only at edges, and as they are they keep creases crisp. A lens, several motion
    samples and a mirror that is not quite smooth make noise, which is filtered first. The albedo seen through
    glass stays as it is: filtered, it would lose what glass shows small.
    Raises MachineError where the denoiser cannot run.
    """
    is_followed = "denoise_albedo" in frame.arrays
    albedo = frame["denoise_albedo" if is_followed else "albedo"]
    normal = frame["denoise_normal" if is_followed else "normal"]
    # A frame that was read has its file's header as facts, where `shutter` is None without motion blur.
    is_noisy = frame.facts.get("lens_radius", 0.0) > 0.0 or frame.facts.get("motion_samples", 1) > 1
    if is_noisy or (is_followed and not frame.facts.get("is_clear", False)):
        albedo = np.clip(_filtered("albedo", effort, albedo=_finite(albedo)), 0.0, 1.0)
    if is_noisy or is_followed:
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
    try:
        return _filter(kind).run(effort, images)
    except RuntimeError as error:
        raise MachineError(f"the denoiser cannot run: {error}; render with denoise: off") from None


@cache
def _device() -> Any:
    """Return the denoiser's device, of which a process has one: its filters share their working memory."""
    import pyoidn  # slow to import, and many processes denoise nothing

    device = pyoidn.Device()
    device.commit()
    return device


@cache
def _filter(kind: str) -> _Filter:
    """Return the filter of one kind of image."""
    import pyoidn

    return _Filter(pyoidn.Filter(_device()), is_guided=kind == "color")


@dataclass(eq=False)
class _Filter:
    """A filter that is kept from picture to picture, which spares it a tenth of its time.

    images  what it refers to: it keeps no images alive
    """

    filter: Any
    is_guided: bool
    images: dict[str, Pixels] = field(default_factory=dict)

    def run(self, effort: str, images: dict[str, Pixels]) -> Pixels:
        """Return the first of the images, filtered. Raises RuntimeError where the denoiser cannot run."""
        import pyoidn

        given = {name: np.ascontiguousarray(image, dtype=np.float32) for name, image in images.items()}
        clean = np.empty_like(next(iter(given.values())))
        self.images = {**given, pyoidn.OIDN_IMAGE_OUTPUT: clean}
        for name, image in self.images.items():
            self.filter.set_image(name, image, pyoidn.OIDN_FORMAT_FLOAT3)
        self.filter.set_bool("hdr", self.is_guided)
        self.filter.set_bool("cleanAux", self.is_guided)
        self.filter.set_quality(getattr(pyoidn, f"OIDN_QUALITY_{effort.upper()}"))
        self.filter.commit()
        self.filter.execute()
        if (reason := _device().get_error()) is not None:
            raise RuntimeError(reason)
        return clean
