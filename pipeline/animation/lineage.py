"""Of which vertices of an earlier frame those of a later one descend."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.animation.frame import MeshFrame
from pipeline.arrays import AnyArray
from pipeline.errors import UsageError
from pipeline.mesh.identity import IDENTITY
from pipeline.mesh.lineage import Ancestry, ancestry


def descent(frames: Sequence[MeshFrame]) -> Ancestry:
    """How the vertices of the last of these frames descend from those of the first.

    frames  one after the other, none left out; of those between only the births are looked at

    `descent(frames).mixed(frames[0].mesh.vertices)` is where the present vertices would have been then, and
    what moved since is their motion.

    Raises UsageError where there are no frames or one is left out, and where identities are not kept.
    """
    numbers = [frame.number for frame in frames]
    if not numbers or numbers != list(range(numbers[0], numbers[0] + len(numbers))):
        raise UsageError(f"frames {numbers} are not one after the other; give all from the first to the last")
    births = [_births(frame) for frame in frames]
    now, then = (frame.mesh.attributes[IDENTITY] for frame in (frames[-1], frames[0]))
    return ancestry(now, then, np.concatenate(births))


def _births(frame: MeshFrame) -> AnyArray:
    if frame.births is None or IDENTITY not in frame.mesh.attributes:
        raise UsageError(
            f"frame {frame.number} has no identities, so nobody knows whose its vertices are; method "
            "polyhedra keeps none"
        )
    return frame.births
