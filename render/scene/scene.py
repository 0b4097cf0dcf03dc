"""Scenes: everything that one frame shows, as plain descriptions."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from render.scene.camera import Camera
from render.scene.lights import LightRig
from render.scene.materials import Material
from render.scene.spheres import Spheres
from render.scene.stage import Stage, StagePlacement
from render.scene.surface import Surface
from render.scene.working_space import REC709, WorkingSpace, in_working_space


@dataclass(frozen=True, eq=False)
class MotionSample:
    """The moving parts of a scene at one time: subject, placement of the stage, camera."""

    subject: Surface | Spheres
    placement: StagePlacement
    camera: Camera

    def pixels(self, size: tuple[int, int], points: ArrayLike | None = None) -> NDArray[np.float64]:
        """Project the subject's points, or others (N, 3): return pixels right and up of the middle, and
        depth.

        size  width and height of the picture
        """
        if points is None:
            points = self.subject.centres if isinstance(self.subject, Spheres) else self.subject.vertices
        projected = self.camera.project(points, size[0] / size[1])
        return projected * (size[0] / 2.0, size[1] / 2.0, 1.0)

    @property
    def vertex_count(self) -> int:
        """Vertices of the subject; of spheres, at least."""
        subject = self.subject
        return 42 * len(subject.centres) if isinstance(subject, Spheres) else len(subject.vertices)

    def surface(self, width: int) -> Surface:
        """Return the subject as triangles, fine enough for a picture `width` pixels wide."""
        subject = self.subject
        return subject.surface(self.camera, width) if isinstance(subject, Spheres) else subject

    def with_attributes(self, attributes: dict[str, NDArray[np.float32]]) -> MotionSample:
        """Return the sample with more attributes of the subject's points."""
        merged = {**self.subject.attributes, **attributes}
        return replace(self, subject=replace(self.subject, attributes=merged))


@dataclass(frozen=True, eq=False)
class Scene:
    """The scene of one frame: the subject and its material, lights, stage and camera.

    working_space  the space that light is computed in; colours of the scene are linear Rec.709
    """

    subject: Surface | Spheres
    material: Material
    lights: LightRig
    stage: Stage
    placement: StagePlacement
    camera: Camera
    working_space: WorkingSpace = REC709

    @property
    def motion_sample(self) -> MotionSample:
        """The moving parts of the scene."""
        return MotionSample(self.subject, self.placement, self.camera)

    @property
    def objects(self) -> tuple[str, ...]:
        """The names of the objects that the lens may see."""
        lines = ("wireframe",) if self.material.wireframe else ()
        return ("subject", *lines, *self.stage.objects)

    def at(self, sample: MotionSample) -> Scene:
        """Return the scene with the moving parts of a motion sample."""
        return replace(self, subject=sample.subject, placement=sample.placement, camera=sample.camera)

    def converted(self) -> Scene:
        """Return the scene with its colours in the working space, except vertex colours."""
        space = self.working_space
        return replace(
            self,
            material=in_working_space(self.material, space),
            lights=in_working_space(self.lights, space),
            stage=in_working_space(self.stage, space),
        )
