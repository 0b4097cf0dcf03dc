"""Remove the noise of one frame with Intel's Open Image Denoise, guided by albedo and normals."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from render.base.errors import MachineError
from render.frame.rendered_frame import RenderedFrame


def denoise(layers: RenderedFrame, effort: str = "high") -> NDArray[np.float32]:
    """The beauty without noise, float32 (H, W, 3). Needs the layers beauty, albedo and normal.

    `effort` is a Quality's `denoise`: "balanced" takes half the time of "high" and is hard to tell from it
    at small sizes. A pinhole's first hit has no noise but at edges, so the guides count as clean:
    that keeps creases crisp. Behind a lens that blurs they have noise too, and the denoiser is told so.
    Raises MachineError where the denoiser cannot run.
    """
    import pyoidn  # which pictures that keep their noise, or are there already, need not wait for

    beauty = np.maximum(layers["beauty"], np.float32(0.0))
    try:
        clean = pyoidn.denoise(
            beauty,
            albedo=layers["albedo"],
            normal=layers["normal"],
            hdr=True,
            clean_aux=not layers.facts.get("lens_radius", 0.0),
            quality=effort,
        )
    except RuntimeError as error:
        raise MachineError(f"the denoiser cannot run: {error}; render with denoise: off") from None
    return np.asarray(clean, dtype=np.float32)
