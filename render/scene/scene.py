"""Scenes: everything that one frame shows, as plain descriptions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flowsculpt.render.scene.materials import Material, PatternedMaterial
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.rgb_spaces import REC709, WorkingSpace, converted_pixels, in_working_space
from flowsculpt.render.scene.scene_lights import LightRig
from flowsculpt.render.scene.scene_stage import Stage, StagePlacement
from flowsculpt.render.scene.surface import Spheres, Surface

Geometry = Surface | Spheres
"""What a subject is made of."""

SUBJECT = "subject"
"""The name of the subject of a scene that has one."""


@dataclass(frozen=True, eq=False)
class MotionSample:
    """The moving parts of a scene at one time: subject, placement of the stage, camera.

    others  further subjects, in the order of `Scene.others`
    """

    subject: Geometry
    placement: StagePlacement
    camera: Camera
    others: tuple[Geometry, ...] = ()

    @property
    def subjects(self) -> tuple[Geometry, ...]:
        """All subjects."""
        return self.subject, *self.others

    def each(self) -> tuple[MotionSample, ...]:
        """Return a sample with one subject for each."""
        return tuple(replace(self, subject=subject, others=()) for subject in self.subjects)

    def pixels(self, size: tuple[int, int], points: ArrayLike | None = None) -> NDArray[np.float64]:
        """Project the points of all subjects, or others (N, 3): return pixels right and up of the middle, and
        depth.

        size  width and height of the picture
        """
        if points is None:
            points = _joined([s.centres if isinstance(s, Spheres) else s.vertices for s in self.subjects])
        projected = self.camera.project(points, size[0] / size[1])
        return projected * (size[0] / 2.0, size[1] / 2.0, 1.0)

    @property
    def vertex_count(self) -> int:
        """Vertices of all subjects; of spheres, at least."""
        return sum(42 * len(s.centres) if isinstance(s, Spheres) else len(s.vertices) for s in self.subjects)

    def with_surfaces(
        self, width: int, attributes: Sequence[Mapping[str, NDArray[np.float32]]] | None = None
    ) -> MotionSample:
        """Return the sample with its subjects as triangles, fine enough for a picture `width` pixels wide.

        attributes  more attributes of the points of each subject
        """
        more = [{}] * len(self.subjects) if attributes is None else attributes
        first, *others = (
            _triangles(replace(s, attributes={**s.attributes, **added}), self.camera, width)
            for s, added in zip(self.subjects, more, strict=True)
        )
        return replace(self, subject=first, others=tuple(others))


def _triangles(subject: Geometry, camera: Camera, width: int) -> Surface:
    return subject.surface(camera, width) if isinstance(subject, Spheres) else subject


def _joined(arrays: Sequence[NDArray[np.float32]]) -> NDArray[np.float32]:
    return arrays[0] if len(arrays) == 1 else np.concatenate(arrays)


def stage_fades(camera: Camera, lights: LightRig) -> bool:
    """Tell whether the stage fades into the dark: a wide camera sees past its rim, where there is no sky."""
    return camera.projection.is_wide and not lights.shows_sky


@dataclass(frozen=True, eq=False)
class SceneSubject:
    """A subject of a scene: its name, its points and its material."""

    name: str
    geometry: Geometry
    material: Material

    @property
    def shape_name(self) -> str:
        """The name of its shape in a Mitsuba scene, which no other shape and no emitter has."""
        return self.name if self.name == SUBJECT else f"{SUBJECT}:{self.name}"

    @property
    def surface(self) -> Surface:
        """Its triangles, once it is cut into triangles."""
        assert isinstance(self.geometry, Surface), "spheres are cut into triangles first"
        return self.geometry

    @property
    def wireframe_name(self) -> str:
        """The name of the lines along its edges, in coverage and mattes."""
        return "wireframe" if self.name == SUBJECT else f"{self.name}_wireframe"


@dataclass(frozen=True, eq=False)
class Scene:
    """The scene of one frame: the subject and its material, lights, stage and camera.

    working_space  the space that light is computed in; colours of the scene are linear Rec.709
    others         further subjects, each with its own material
    name           of the first subject, where there are others
    """

    subject: Surface | Spheres
    material: Material
    lights: LightRig
    stage: Stage
    placement: StagePlacement
    camera: Camera
    working_space: WorkingSpace = REC709
    others: tuple[SceneSubject, ...] = ()
    name: str = SUBJECT

    @property
    def subjects(self) -> tuple[SceneSubject, ...]:
        """All subjects."""
        return SceneSubject(self.name, self.subject, self.material), *self.others

    @property
    def motion_sample(self) -> MotionSample:
        """The moving parts of the scene."""
        others = tuple(other.geometry for other in self.others)
        return MotionSample(self.subject, self.placement, self.camera, others)

    @property
    def is_lit(self) -> bool:
        """True if light is traced; False for a material that brings its own light and background."""
        return all(subject.material.is_lit for subject in self.subjects)

    @property
    def stage_fades(self) -> bool:
        """True if the stage fades into the dark."""
        return stage_fades(self.camera, self.lights)

    @property
    def is_clear(self) -> bool:
        """True if light passes through one of its subjects."""
        return any(subject.material.is_clear for subject in self.subjects)

    @property
    def objects(self) -> dict[str, str]:
        """The objects that the lens may see: their names, and those of their shapes."""
        seen = {}
        for subject in self.subjects:
            seen[subject.name] = subject.shape_name
            if subject.material.wireframe:
                seen[subject.wireframe_name] = subject.wireframe_name
        return {**seen, **{name: name for name in self.stage.objects}}

    def at(self, sample: MotionSample) -> Scene:
        """Return the scene with the moving parts of a motion sample."""
        moved = [replace(s, geometry=g) for s, g in zip(self.subjects, sample.subjects, strict=True)]
        return replace(self._with(moved), placement=sample.placement, camera=sample.camera)

    def converted(self) -> Scene:
        """Return the scene with its colours in the working space. Its subjects are triangles."""
        space = self.working_space
        converted = self._with([_converted(subject, space) for subject in self.subjects])
        lights, stage = in_working_space(self.lights, space), in_working_space(self.stage, space)
        return replace(converted, lights=lights, stage=stage)

    def _with(self, subjects: Sequence[SceneSubject]) -> Scene:
        first, *others = subjects
        return replace(self, subject=first.geometry, material=first.material, others=tuple(others))


def _converted(subject: SceneSubject, space: WorkingSpace) -> SceneSubject:
    """Return a subject with its material and the vertex colours that this shows in the working space."""
    surface, material = subject.surface, in_working_space(subject.material, space)
    name = material.colour_from if isinstance(material, PatternedMaterial) else None
    if name is not None and name in surface.attributes:
        colours = converted_pixels(surface.attributes[name], space.name)
        surface = replace(surface, attributes={**surface.attributes, name: colours})
    if surface.paint is not None and surface.paint.colours is not None:
        colours = converted_pixels(surface.paint.colours, space.name)
        surface = replace(surface, paint=replace(surface.paint, colours=colours))
    return replace(subject, geometry=surface, material=material)
