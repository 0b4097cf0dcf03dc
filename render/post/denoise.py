"""Denoise one frame with Intel's Open Image Denoise, guided by albedo and normals."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from render.base.errors import MachineError
from render.scene.aovs import RenderedFrame


def denoise(frame: RenderedFrame, effort: str = "high") -> NDArray[np.float32]:
    """Return the denoised beauty, float32 (H, W, 3), of a frame with the AOVs beauty, albedo and normal.

    effort  a Quality's `denoise`: "balanced" takes half the time of "high" and looks alike at small sizes

    Albedo and normal of a pinhole camera are noisy only at edges, so they count as clean, which keeps creases
    crisp. Behind a lens with depth of field they are noisy too, and the denoiser is told so.
    Raises MachineError where the denoiser cannot run.
    """
    import pyoidn  # slow to import, and many processes denoise nothing

    beauty = np.maximum(frame["beauty"], np.float32(0.0))
    try:
        clean = pyoidn.denoise(
            beauty,
            albedo=frame["albedo"],
            normal=frame["normal"],
            hdr=True,
            clean_aux=not frame.facts.get("lens_radius", 0.0),
            quality=effort,
        )
    except RuntimeError as error:
        raise MachineError(f"the denoiser cannot run: {error}; render with denoise: off") from None
    return np.asarray(clean, dtype=np.float32)
