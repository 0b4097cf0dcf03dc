"""AOVs: the table of them, a rendered frame, which holds them as arrays, and the values of vertex AOVs."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.base.work_clock import Timing

if TYPE_CHECKING:  # names of AOVs are known without it
    from flowsculpt.render.scene.scene import MotionSample

Pixels = NDArray[np.float32]
Attributes = Mapping[str, NDArray[np.float32]]
"""Values of a subject's points by name, (N, 3) each."""


@dataclass(frozen=True)
class Aov:
    """An AOV: the letters of its channels, their precision in a file (half or float), and its meaning."""

    letters: str
    precision: str
    meaning: str


ALWAYS = {
    "beauty": Aov("RGB", "half", "light"),
    "albedo": Aov("RGB", "half", "reflectance"),
    "normal": Aov("XYZ", "half", "shading normal"),
    "position": Aov("XYZ", "float", "position in the scene"),
    "depth": Aov("Z", "float", "distance from the lens"),
    "matte": Aov("A", "half", "coverage of the pixel by the subject"),
    "alpha": Aov("A", "half", "coverage of the pixel by all that the lens sees"),
}
"""AOVs of every frame."""

EXTRA = {
    "velocity": Aov("XYZ", "half", "of the subject, scene units per second"),
    "motion": Aov("XY", "float", "pixels right and up from this frame to the next, as the camera sees it"),
    "before": Aov("XYZ", "half", "of the subject, to its position a frame earlier, scene units"),
    "after": Aov("XYZ", "half", "of the subject, to its position a frame later, scene units"),
    "rest": Aov("XYZ", "float", "position before any flow moved it"),
    "noise": Aov("Y", "half", "standard error of the beauty's luminance"),
    "samples": Aov("N", "float", "samples per pixel"),
}
"""AOVs of a frame that asks for them."""

DENOISER = {
    "denoise_albedo": Aov("RGB", "half", "reflectance of the first rough surface, through mirrors and glass"),
    "denoise_normal": Aov("XYZ", "half", "shading normal of that surface, 0 where there is none"),
}
"""AOVs for the denoiser, of frames in which they differ from albedo and normal."""

AOVS = {**ALWAYS, **EXTRA, **DENOISER}

COMPUTED = {
    "planar_depth": Aov("Z", "float", "distance from the camera's plane"),
    "backward_motion": Aov("XY", "float", "pixels right and up from this frame to the one before"),
    "shadow": Aov("A", "half", "part of the pixel that a shadow on the shadow catcher darkens"),
    "denoised": Aov("RGB", "half", "light without noise"),
}
"""Layers that are computed from the AOVs of a frame."""

COVERAGE = "coverage."
"""Prefix of layers with the coverage of the pixel by one object: `coverage.subject`, `coverage.plinth`."""

COPY = "copy"
"""The vertex attribute (V, 1) that tells copies of subjects apart: a number from 1 on, 0 for none."""

COPIES = "copies"
"""Prefix of layers with the copies that a pixel shows, `copies00`: number and coverage, twice."""

MOST_RANKS = 6
"""Copies, and IDs of cryptomatte, of a pixel that are kept, as is usual: three layers."""

NEEDED_BY_AOV = {
    "velocity": "velocities",
    "motion": "the next frame",
    "before": "the frame before",
    "after": "the next frame",
    "rest": "rest positions",
}
"""Vertex data that an AOV needs, in the words of messages."""

VERTEX_AOVS = tuple(NEEDED_BY_AOV)
"""AOVs that show an attribute of the subject's vertices."""


@dataclass(frozen=True, eq=False)
class RenderedFrame:
    """The AOVs of a frame as float32 arrays, (H, W, 3) or (H, W), by name.

    `facts` are the same whenever the frame is rendered; `timings` say where the time of this rendering went.

    beauty    linear Rec.709 radiance
    albedo    reflectance, within 0 … 1
    normal    shading normal, scene axes
    position  scene units
    depth     distance from the camera, scene units
    matte     coverage of the pixel by the subject, 0 … 1
    alpha     coverage of the pixel by all that the lens sees, 0 … 1; the beauty is premultiplied by it

    All are means over the pixel: at the subject's outline (matte between 0 and 1) position and depth are
    between those of the subject and the stage.
    """

    arrays: Mapping[str, Pixels]
    facts: Mapping[str, Any] = field(default_factory=dict)
    timings: Mapping[str, Timing] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Pixels:
        return self.arrays[name]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        height, width = next(iter(self.arrays.values())).shape[:2]
        return width, height


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
            motion = _motion(sample, sample.pixels(size), following.pixels(size), size)
            values[name] = np.pad(motion, ((0, 0), (0, 1))).astype(np.float32)
            continue
        given = sample.subject.rest if name == "rest" else sample.subject.attributes.get(name)
        if name == "motion" or given is None:
            raise BadInputError(f"AOV {name!r} needs {NEEDED_BY_AOV[name]}, which the surface was not given")
        values[name] = given
    return values


def stage_motion(
    position: NDArray[np.float64], sample: MotionSample, following: MotionSample, size: tuple[int, int]
) -> NDArray[np.float64]:
    """Return the pixels (H, W, 2) that points of the stage, at positions (H, W, 3), move in the picture.

    The stage moves with the subject's placement, and the camera as in `following`.
    """
    points = position.reshape(-1, 3)
    moved = sample.placement.moved(points, following.placement)
    motion = _motion(sample, sample.pixels(size, points), following.pixels(size, moved), size)
    return motion.reshape(*position.shape[:2], 2)


def _motion(
    sample: MotionSample, before: NDArray[np.float64], after: NDArray[np.float64], size: tuple[int, int]
) -> NDArray[np.float64]:
    """Return the motion (N, 2) of projected points (N, 3), 0 for those behind the camera."""
    in_front = (before[:, 2] > 0.0) & (after[:, 2] > 0.0)
    motion = sample.camera.projection.motion(after[:, :2] - before[:, :2], size[0])
    return np.where(in_front[:, None], motion, 0.0)
