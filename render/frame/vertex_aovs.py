"""AOVs that show an attribute of the subject's vertices, such as velocity or motion.

Mitsuba has no such AOV, but it has one for albedo. A scene whose subject has the attribute as its colour is
rendered with the same samples as the auxiliary AOVs; minus the same scene with the attribute 0, it shows the
attribute alone.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping

import numpy as np
from numpy.typing import NDArray

from render.base.errors import BadInputError
from render.scene.aovs import NEEDED_BY_AOV, VERTEX_AOVS
from render.scene.scene import MotionSample

Picture = NDArray[np.float64]
Attributes = Mapping[str, NDArray[np.float32]]


def vertex_attributes(
    sample: MotionSample, following: MotionSample | None, aovs: Collection[str], size: tuple[int, int]
) -> dict[str, NDArray[np.float32]]:
    """Return the values (N, 3) of a sample's points that `aovs` show, by name.

    `motion` is computed, with 0 as its third channel; `rest` are the rest positions; others are attributes.

    following  the same points and camera at the next frame; for motion
    size       width and height in pixels

    Raises BadInputError where something is missing.
    """
    values: dict[str, NDArray[np.float32]] = {}
    for name in [name for name in aovs if name in VERTEX_AOVS]:
        if name == "motion" and following is not None:
            after, before = following.pixels(size), sample.pixels(size)
            in_front = (after[:, 2] > 0.0) & (before[:, 2] > 0.0)
            motion = np.where(in_front[:, None], after[:, :2] - before[:, :2], 0.0)
            values[name] = np.pad(motion, ((0, 0), (0, 1))).astype(np.float32)
            continue
        given = sample.subject.rest if name == "rest" else sample.subject.attributes.get(name)
        if name == "motion" or given is None:
            raise BadInputError(f"AOV {name!r} needs {NEEDED_BY_AOV[name]}, which the surface was not given")
        values[name] = given
    return values


def render_attributes(
    attributes: Attributes, render: Callable[[NDArray[np.float32]], Picture]
) -> dict[str, Picture]:
    """Return the means (H, W, 3) of attributes (V, 3) over the pixels, 0 where the subject is not.

    render  renders the scene with an attribute as the subject's colour
    """
    if not attributes:
        return {}
    others = render(np.zeros_like(next(iter(attributes.values()))))
    return {name: render(values) - others for name, values in attributes.items()}


def stage_motion(
    position: Picture, sample: MotionSample, following: MotionSample, size: tuple[int, int]
) -> Picture:
    """Return the pixels (H, W, 2) that points of the stage, at positions (H, W, 3), move in the picture.

    The stage moves with the subject's placement, and the camera as in `following`.
    """
    points = position.reshape(-1, 3)
    moved = sample.placement.moved(points, following.placement)
    before, after = sample.pixels(size, points), following.pixels(size, moved)
    in_front = (before[:, 2] > 0.0) & (after[:, 2] > 0.0)
    motion = np.where(in_front[:, None], after[:, :2] - before[:, :2], 0.0)
    return motion.reshape(*position.shape[:2], 2)
