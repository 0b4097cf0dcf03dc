"""Light groups: the light of some emitters each, as layers of a frame. They sum to the beauty."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Pixels = NDArray[np.float32]

PREFIX = "light_"
"""Beginning of the names of their layers: `light_key`."""

_MAX_HALF = float(np.finfo(np.float16).max)


@dataclass(frozen=True)
class LightGroup:
    """Lights that share one light group.

    name    of the group
    lights  their names in the rig
    """

    name: str
    lights: tuple[str, ...]

    @property
    def layer(self) -> str:
        """The name of its layer."""
        return PREFIX + self.name


def groups_in(arrays: Mapping[str, Pixels]) -> dict[str, Pixels]:
    """Return the light groups (H, W, 3) among the layers of a frame, by group, in the order of their sum."""
    return {name.removeprefix(PREFIX): arrays[name] for name in sorted(arrays) if name.startswith(PREFIX)}


def with_beauty(groups: Mapping[str, NDArray[Any]]) -> dict[str, Pixels]:
    """Return the layers of light groups (H, W, 3) and `beauty`, their sum.

    Groups are rounded to half float before they are added, in alphabetical order and float32. So the groups
    in a file, added likewise, are the beauty in the file to the last bit.
    """
    layers = {
        PREFIX + name: np.clip(groups[name], -_MAX_HALF, _MAX_HALF).astype(np.float16).astype(np.float32)
        for name in sorted(groups)
    }
    beauty = np.zeros_like(next(iter(layers.values())))
    for layer in layers.values():
        beauty += layer
    return {"beauty": beauty, **layers}
