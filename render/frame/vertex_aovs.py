"""The layers of a picture: which there are, what they mean, and how they are found where Mitsuba knows none.

Mitsuba tells nothing of what a vertex brings along, but it tells the albedo of a surface. So a scene like the
others, whose subject is dyed with what is asked for, is looked at with the very samples of the other layers;
without the dye it shows what is not the subject, which is taken away again.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping

import numpy as np
from numpy.typing import NDArray

from render.base.errors import BadInputError
from render.frame.motion_samples import Moment
from render.scene.aovs import NEEDED_BY_AOV, VERTEX_AOVS

Array = NDArray[np.float64]
Dyed = Callable[[NDArray[np.float32]], Array]


def marks_of(
    moment: Moment, following: Moment | None, aovs: Collection[str], size: tuple[int, int]
) -> dict[str, NDArray[np.float32]]:
    """By name (N, 3) of the points of a moment: what `aovs` asks of them: motion, its third channel
    0, the material as rest, and attributes of these names.

    following  the same points at the next frame, seen from there; for motion
    size       width and height in pixels

    Raises BadInputError where something is missing.
    """
    found: dict[str, NDArray[np.float32]] = {}
    for name in [name for name in aovs if name in VERTEX_AOVS]:
        if name == "motion" and following is not None:
            there, here = following.pixels(size), moment.pixels(size)
            seen = (there[:, 2] > 0.0) & (here[:, 2] > 0.0)
            values = np.where(seen[:, None], there[:, :2] - here[:, :2], 0.0)
            found[name] = np.pad(values, ((0, 0), (0, 1))).astype(np.float32)
            continue
        given = moment.subject.material if name == "rest" else moment.subject.attributes.get(name)
        if name == "motion" or given is None:
            raise BadInputError(
                f"layer {name!r} needs {NEEDED_BY_AOV[name]}, which the surface was not given"
            )
        found[name] = given
    return found


def looked_at(marks: Mapping[str, NDArray[np.float32]], look: Dyed) -> dict[str, Array]:
    """By name (H, W, 3): the means of marks (V, 3) over the pixels, 0 where the subject is not.

    look  the albedo (H, W, 3) of the scene whose subject is dyed with the values given
    """
    if not marks:
        return {}
    others = look(np.zeros_like(next(iter(marks.values()))))
    return {name: look(values) - others for name, values in marks.items()}


def stage_motion(position: Array, here: Moment, following: Moment, size: tuple[int, int]) -> Array:
    """(H, W, 2) pixels that the stage moves in the picture, from positions (H, W, 3) that are on it.

    The stage goes with the placement of the subject, and the camera as it does.
    """
    points = position.reshape(-1, 3)
    moved = here.placement.carried(points, following.placement)
    before, after = here.pixels(size, points), following.pixels(size, moved)
    seen = (before[:, 2] > 0.0) & (after[:, 2] > 0.0)
    motion = np.where(seen[:, None], after[:, :2] - before[:, :2], 0.0)
    return motion.reshape(*position.shape[:2], 2)
