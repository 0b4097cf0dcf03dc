"""Mattes as a compositor's Cryptomatte node picks them."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.post.compositing import id_bits


def matte_of(name: str, crypto: str, layers: Mapping[str, NDArray[np.float32]]) -> NDArray[np.float32]:
    """Return the coverage (H, W) of a name in a set of mattes."""
    own = np.uint32(id_bits(name)).view(np.float32)
    ranked = [layer for label, layer in layers.items() if label.startswith(crypto)]
    pairs = [(layer[..., first], layer[..., first + 1]) for layer in ranked for first in (0, 2)]
    return np.sum([np.where(ids == own, weights, np.float32(0.0)) for ids, weights in pairs], axis=0)
