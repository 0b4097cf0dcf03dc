"""Remove the noise of one frame with Intel's Open Image Denoise, guided by albedo and normals."""

from __future__ import annotations

import numpy as np
import pyoidn
from numpy.typing import NDArray

from render.errors import RenderEnvironmentError
from render.frame import Layers

CLEAN_SAMPLES = 16
"""From this many samples a pixel on, a box-filtered albedo and normal are clean enough to be trusted."""


def denoise(layers: Layers) -> NDArray[np.float32]:
    """The beauty without noise, float32 (H, W, 3). Needs the layers beauty, albedo and normal.

    With few samples the guides are noisy along edges and are themselves denoised first, after which
    they count as clean; this is what keeps creases crisp at 4 samples.
    Raises RenderEnvironmentError where the denoiser cannot run.
    """
    albedo, normal = layers["albedo"], layers["normal"]
    try:
        if int(layers.facts.get("samples", CLEAN_SAMPLES)) < CLEAN_SAMPLES:
            albedo, normal = (_guide(guide, name) for guide, name in ((albedo, "albedo"), (normal, "normal")))
        beauty = np.maximum(layers["beauty"], np.float32(0.0))
        clean = pyoidn.denoise(beauty, albedo=albedo, normal=normal, hdr=True, clean_aux=True)
    except RuntimeError as error:
        raise RenderEnvironmentError(f"the denoiser cannot run: {error}; render with denoise: none") from None
    return np.asarray(clean, dtype=np.float32)


def _guide(picture: NDArray[np.float32], name: str) -> NDArray[np.float32]:
    """OIDN's own prefilter for a guide; it takes pictures in 0 … 1, so normals are shifted there."""
    if name == "albedo":
        return np.asarray(pyoidn.denoise(picture), dtype=np.float32)
    return np.asarray(pyoidn.denoise(picture * 0.5 + 0.5), dtype=np.float32) * 2.0 - 1.0
