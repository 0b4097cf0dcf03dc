"""A picture of a surface on its stage. It takes one thread and lets others run."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from render.camera import Camera
from render.colour import to_display
from render.lights import LIGHTS
from render.look import LOOKS, Look
from render.plain import Triple
from render.raster._kernels_fill import fill
from render.raster._kernels_light import light
from render.raster._kernels_pixels import FINER, draw_edges, empty, mix
from render.raster.lamps import lamps_of
from render.raster.parts import Floats, Lens, Set, Shape, stage_shape
from render.raster.shadow import Shadow
from render.stage import STAGES, Placement

BODILESS = ("metal", "brushed")
UNCOATED = ("diffuse", "smoke")
COAT = 0.05
"""Models that have a mirror's colour and no other, models without a clear coat, and what others reflect."""

SHARPNESS = (6.0, 160.0)
"""Between which highlights are: sharper ones would fall between vertices, and be dots."""


class Edges(NamedTuple):
    """How the edges of faces are drawn: display colour, how opaque, and how wide in pixels."""

    colour: Triple = (0.06, 0.07, 0.08)
    opacity: float = 0.55
    width: float = 0.6


class Preview(NamedTuple):
    """picture: display values (H, W, 3), 0 … 1; depth (H, W) along the lens, infinite where nothing is."""

    picture: NDArray[np.float32]
    depth: Floats


def preview(
    subject: Shape,
    around: Set,
    camera: Camera,
    size: tuple[int, int],
    display: str,
    edges: Edges | None = None,
) -> Preview:
    """A picture of a surface on its stage, `size` (width, height) pixels."""
    around = replace(around, lights=around.lights.plainly())
    width, height = size
    frame = _Frame.of(Lens.of(camera, width / height), size)
    parts = [subject] if around.stage.kind == "none" else [subject, stage_shape(around)]
    seen = [frame.drawn(part) for part in parts]
    shadow, lamps = Shadow.of(subject, around), lamps_of(around)
    picture = np.empty((height, width, 3), np.float32)
    behind = _shown(np.array([around.lights.sky.horizon], np.float32), around, display)[0]
    empty(frame.face, behind, picture)
    for part in seen:
        values = np.zeros((len(part.shape.vertices), 9), np.float32)
        which = np.flatnonzero(part.seen)
        values[which, :6] = _shown(part.lit(which, around, lamps, camera), around, display).reshape(-1, 6)
        values[which, 6:] = shadow.places(part.shape, which)
        looked_up = shadow.near, shadow.blocks
        mix(part.corners, part.faces, part.first, values, looked_up, frame.face, picture)
    if edges is not None:
        ink = np.array([*edges.colour, edges.opacity, edges.width])
        draw_edges(seen[0].screen, seen[0].faces, seen[0].first, frame.face, ink, picture)
    return Preview(picture, frame.depth())


def prepare() -> None:
    """Compile the kernels, so that the first preview need not wait for it."""
    from render.raster.lines import with_lines

    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    around = Set(LIGHTS["studio"], STAGES["cyclorama"], Placement())
    camera = Camera((0.0, 0.0, 6.0), (0.0, 0.0, 0.0))
    for points in (corners, corners.astype(np.float32)):
        shape = Shape(points, points, np.array([[0, 1, 2]], np.int32), LOOKS["clay"])
        shown = preview(shape, around, camera, (8, 4), "rec709", Edges())
    with_lines(shown, np.zeros((1, 2, 3)), np.zeros((1, 2, 3)), np.ones((1, 2)), camera, 1.0)


@dataclass(frozen=True, eq=False)
class _Drawn:
    """A shape in the picture: its corners and where they fall, what its first face is called, and which of
    its vertices (V,) may be seen."""

    shape: Shape
    faces: NDArray[np.int32]
    corners: Floats
    screen: Floats
    first: int
    seen: NDArray[np.bool_]

    def lit(self, which: NDArray[np.intp], around: Set, lamps: Floats, camera: Camera) -> NDArray[np.float32]:
        """(2 N, 3): what each sends to the eye with the key light, and without it."""
        shape, sky = self.shape, around.lights.sky
        colours = np.array([shape.look.colour]) if shape.colours is None else shape.colours
        sharp = float(np.clip(2.0 / max(shape.look.roughness, 0.02) ** 2 - 2.0, *SHARPNESS))
        above = np.array([sky.horizon, sky.zenith, (sharp, 0.0, 0.0)])
        out = np.empty((len(which), 6), np.float32)
        light(
            shape.vertices,
            shape.normals,
            np.ascontiguousarray(colours, np.float64),
            which,
            np.array(camera.origin),
            _reflects(shape.look),
            above,
            lamps,
            out,
        )
        return out.reshape(-1, 3)


@dataclass(frozen=True, eq=False)
class _Frame:
    """Which faces are seen in a picture, and one over their depth, FINER times as finely as its pixels."""

    lens: Lens
    near: NDArray[np.float32]
    face: NDArray[np.int32]
    shapes: list[_Drawn]

    @classmethod
    def of(cls, lens: Lens, size: tuple[int, int]) -> _Frame:
        shape = FINER * size[1], FINER * size[0]
        return cls(lens, np.zeros(shape, np.float32), np.full(shape, -1, np.int32), [])

    def drawn(self, shape: Shape) -> _Drawn:
        last = self.shapes[-1] if self.shapes else None
        corners, screen = self.lens.project(shape.vertices)
        faces = np.ascontiguousarray(shape.faces, np.int32)
        first, seen = last.first + len(last.faces) if last else 0, np.zeros(len(corners), np.bool_)
        fill(corners, screen, faces, first, shape.closed, self.lens.near, self.near, self.face, seen)
        self.shapes.append(_Drawn(shape, faces, corners, screen, first, seen))
        return self.shapes[-1]

    def depth(self) -> Floats:
        """(H, W), in the middle of each pixel."""
        with np.errstate(divide="ignore"):
            return 1.0 / self.near[FINER // 2 :: FINER, FINER // 2 :: FINER].astype(np.float64)


def _reflects(look: Look) -> Floats:
    """(3,), as `light` takes it."""
    if look.model in BODILESS:
        return np.array([0.0, 1.0, 0.0])
    return np.array([1.0, 0.0, 0.0 if look.model in UNCOATED else COAT])


def _shown(light: NDArray[np.float32], around: Set, display: str) -> NDArray[np.float32]:
    """(N, 3) linear light as display values."""
    return to_display(light[None], around.lights.exposure, display, around.view).reshape(light.shape)
