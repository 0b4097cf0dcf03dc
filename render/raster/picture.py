"""A picture of a surface on its stage. It takes one thread and lets others run."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from render.base.serialise import Triple
from render.post.colour import to_display
from render.raster.kernels.large_triangles import FINER, Large
from render.raster.kernels.lines import draw_edges
from render.raster.kernels.projection import LARGE, SMALL
from render.raster.kernels.shading import keyed
from render.raster.kernels.triangles import pack, paint, resolve
from render.raster.lines import with_lines
from render.raster.lit import Lighting
from render.raster.parts import Lens, Preview, Set, Shape, stage_shape
from render.raster.shadow import Shadow
from render.raster.sides import Sides
from render.scene.camera import Camera
from render.scene.lights import LIGHTS
from render.scene.materials import LOOKS
from render.scene.stage import STAGES, Placement


class Edges(NamedTuple):
    """How the edges of faces are drawn: display colour, how opaque, and how wide in pixels."""

    colour: Triple = (0.06, 0.07, 0.08)
    opacity: float = 0.55
    width: float = 0.6


def preview(
    subject: Shape,
    around: Set,
    camera: Camera,
    size: tuple[int, int],
    display: str,
    edges: Edges | None = None,
) -> Preview:
    """A picture of a surface on its stage, `size` (width, height) pixels."""
    around = replace(around, lights=around.lights.without_maps())
    frame = _Frame.of(camera, around, size, display, edges is not None)
    seen = Sides.of(subject.as_kernels_take_it(), frame.lens, frame.near.shape)
    shadow = Shadow.of(seen.shape, around, seen.outwards)
    frame.add(seen, shadow)
    if around.stage.kind != "none":
        stage = stage_shape(around.stage, around.placement)
        frame.add(Sides.of(stage, frame.lens, frame.near.shape), shadow, len(subject.faces))
    picture = frame.picture()
    if edges is not None:
        ink = np.array([*edges.colour, edges.opacity, edges.width])
        draw_edges(seen.screen, seen.shape.faces, frame.name, ink, picture)
    return Preview(picture, frame.near[FINER // 2 :: FINER, FINER // 2 :: FINER])


def prepare() -> None:
    """Compile the kernels, so that the first preview need not wait for it."""
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    around = Set(LIGHTS["studio"], STAGES["cyclorama"], Placement())
    camera = Camera((0.0, 0.0, 6.0), (0.0, 0.0, 0.0))
    shape = Shape(corners, corners, np.array([[0, 1, 2]], np.int32), LOOKS["clay"])
    shown = preview(shape, around, camera, (8, 4), "rec709", Edges())
    with_lines(shown, np.zeros((1, 2, 3)), np.zeros((1, 2, 3)), np.ones((1, 2)), camera, 1.0)


@dataclass(frozen=True, eq=False)
class _Frame:
    """A picture that shapes are added to, FINER times as fine as it will be.

    near, colour and name as the kernel `paint` takes them
    """

    lens: Lens
    lighting: Lighting
    around: Set
    display: str
    near: NDArray[np.float32]
    colour: NDArray[np.uint32]
    name: NDArray[np.int32]

    @classmethod
    def of(cls, camera: Camera, around: Set, size: tuple[int, int], display: str, named: bool) -> _Frame:
        width, height = size
        shape = FINER * height, FINER * width
        behind = _shown(np.array([around.lights.sky.horizon], np.float32), around, display)[0]
        return cls(
            Lens.of(camera, width / height),
            Lighting.of(around, camera),
            around,
            display,
            np.zeros(shape, np.float32),
            np.full(shape, pack(*behind), np.uint32),
            np.full(shape if named else (0, 0), -1, np.int32),
        )

    def add(self, seen: Sides, shadow: Shadow, first: int = 0) -> None:
        """Triangles that hide what is there or are hidden by it; `first`, what the first one is called."""
        shown, large = self._small(seen, shadow), self._large(seen, shadow)
        for order in seen.orders:
            paint(
                order, seen.shape.faces, first, seen.screen, shown, large, self.near, self.colour, self.name
            )

    def _small(self, seen: Sides, shadow: Shadow) -> NDArray[np.float32]:
        """(V, 3): what corners of small triangles show."""
        shape, which = seen.shape, seen.corners(SMALL)
        sent = np.empty((len(which), 3), np.float32)
        keyed(
            self.lighting.sent(shape, which, seen.outwards),
            shadow.reaches(shadow.places(shape, which, seen.outwards)),
            sent,
        )
        shown = np.empty((len(shape.vertices), 3), np.float32)
        shown[which] = _shown(sent, self.around, self.display)
        return shown

    def _large(self, seen: Sides, shadow: Shadow) -> Large:
        """What large triangles need."""
        shape, which = seen.shape, seen.corners(LARGE)
        values = np.empty((len(shape.vertices) if len(which) else 0, 9), np.float32)
        sent = self.lighting.sent(shape, which, seen.outwards).reshape(-1, 3)
        values[which, :6] = _shown(sent, self.around, self.display).reshape(-1, 6)
        values[which, 6:] = shadow.places(shape, which, seen.outwards).T
        pixels = self.near.size // FINER**2
        hits, found = np.empty((4, pixels), np.int32), np.empty((12, pixels), np.float32)
        return Large(shape.vertices, *self.lens, values, shadow.near, shadow.blocks, hits, found)

    def picture(self) -> NDArray[np.float32]:
        """(H, W, 3)."""
        rows, columns = self.near.shape
        picture = np.empty((rows // FINER, columns // FINER, 3), np.float32)
        resolve(self.colour, picture)
        return picture


def _shown(light: NDArray[np.float32], around: Set, display: str) -> NDArray[np.float32]:
    """(N, 3) linear light as display values."""
    return to_display(light[None], around.lights.exposure, display, around.view).reshape(light.shape)
