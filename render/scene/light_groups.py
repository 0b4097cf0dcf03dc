"""Light groups: the light of some emitters each, as layers of a frame. They sum to the beauty."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.base.serialise import Triple
from render.scene.working_space import WorkingSpace

Pixels = NDArray[np.float32]

PREFIX = "light_"
"""Beginning of the names of their layers: `light_key`."""

BACKGROUND = "background"
"""What the lens sees of the sky itself, beside subject and stage. It is in a light group as lights are."""

_MAX_HALF = float(np.finfo(np.float16).max)


@dataclass(frozen=True)
class LightGroup:
    """Lights that share one light group.

    name    of the group
    lights  their names in the rig, and BACKGROUND
    """

    name: str
    lights: tuple[str, ...]

    @property
    def layer(self) -> str:
        """The name of its layer."""
        return PREFIX + self.name


def light_layers(names: Iterable[str]) -> list[str]:
    """Return the names of the layers of light groups, in the order of their sum."""
    return sorted(name for name in names if name.startswith(PREFIX))


def groups_in(arrays: Mapping[str, Pixels]) -> dict[str, Pixels]:
    """Return the light groups (H, W, 3) among the layers of a frame, by group, in the order of their sum."""
    return {name.removeprefix(PREFIX): arrays[name] for name in light_layers(arrays)}


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


def mixed(groups: Mapping[str, Pixels], factors: Mapping[str, Triple], space: WorkingSpace) -> Pixels:
    """Return the sum (H, W, 3) of light groups, in alphabetical order, each times a factor.

    factors  red, green, blue of linear Rec.709 by group; others count once
    space    the working space of the groups
    """
    total = np.zeros_like(next(iter(groups.values())))
    for name in sorted(groups):
        factor = space.from_rec709(np.array(factors.get(name, (1.0, 1.0, 1.0))))
        total += groups[name] * factor.astype(np.float32)
    return total
