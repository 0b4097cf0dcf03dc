"""Light that a rough dielectric loses, since its BSDF leaves out scattering between microfacets.

A GGX interface of roughness 0.3 loses a tenth of the light at each passage (Heitz, Hanika, d'Eon and
Dachsbacher, *Multiple-scattering microfacet BSDFs with the Smith model*, 2016). Dividing the BSDF by the
light that it keeps from each direction gives that light back, as Blender's Cycles does. Needs a started
engine of a compiled variant.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

COSINES = 32
"""Rows of the table: cosines of the angle to the normal, evenly from 0 to 1."""

_SAMPLES = 64
"""Samples of a row are the square of this."""


@lru_cache(maxsize=16)
def kept_light(roughness: float, refraction: float) -> NDArray[np.float32]:
    """Return the fraction of light (2, COSINES) that the interface keeps, from outside and from inside."""
    import drjit as dr
    import mitsuba as mi

    bsdf = mi.load_dict(
        {"type": "roughdielectric", "alpha": roughness, "int_ior": refraction, "distribution": "ggx"}
    )
    cosines = np.linspace(0.0, 1.0, COSINES)
    cosines[0] = 0.25 / COSINES
    cosine = np.repeat(np.concatenate([cosines, -cosines]), _SAMPLES**2).astype(np.float32)
    places = (np.stack(np.meshgrid(*2 * [np.arange(_SAMPLES)]), axis=-1).reshape(-1, 2) + 0.5) / _SAMPLES
    x, y = np.tile(places, (2 * COSINES, 1)).T.astype(np.float32)
    si = dr.zeros(mi.SurfaceInteraction3f, len(cosine))
    si.wi = mi.Vector3f(mi.Float(np.sqrt(1.0 - cosine**2)), 0.0, mi.Float(cosine))
    si.sh_frame = mi.Frame3f(mi.Vector3f(0.0, 0.0, 1.0))
    # The lobe is chosen by a number that is even on its own: the golden ratio's multiples.
    lobe = mi.Float((np.arange(len(cosine)) * 0.6180339887498949 % 1.0).astype(np.float32))
    _, weight = bsdf.sample(mi.BSDFContext(mi.TransportMode.Importance), si, lobe, mi.Point2f(x, y))
    return np.array(weight.x).reshape(2, COSINES, -1).mean(axis=2)
