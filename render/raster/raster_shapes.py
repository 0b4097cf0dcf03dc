"""Inputs of a quick preview: shapes, their materials and place on the screen, the stage with its lights.

Materials are a matt body, a mirror of its colour, and a clear coat.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.kernel_cache import compiled
from flowsculpt.render.base.serialise import Colour
from flowsculpt.render.post.view import ACES, ColourView
from flowsculpt.render.scene.materials import (
    BrushedMetal,
    Diffuse,
    Gouraud,
    Material,
    Metal,
    Plastic,
    Satin,
    Smoke,
)
from flowsculpt.render.scene.patterns import Pigment
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.room_shapes import WINDOWS, window_frame
from flowsculpt.render.scene.scene_lights import LightRig
from flowsculpt.render.scene.scene_stage import Stage, StagePlacement
from flowsculpt.render.scene.surface import Surface

Array = NDArray[Any]

FAST_MATH = {"contract", "reassoc", "arcp", "nsz"}
"""Fast-math flags. A preview need not have the same bits on every processor."""

exact, fast = compiled(), compiled(fastmath=FAST_MATH)
"""`exact` keeps the order of operations, `fast` lets the compiler change it."""

LARGE_SIZE = 8
"""Subsamples across from which a triangle is large: shadows are computed per pixel, not at its corners."""

EDGE = 1e-9  # amount by which triangles are enlarged, so that rounding leaves no gap between neighbours
SMALL, LARGE = 1, 2  # bits of a vertex: a corner of small triangles, and of large ones
CLOCKWISE = 2  # shift of these bits for triangles that run clockwise on the screen


@exact
def project(
    vertices: Array, origin: Array, axes: Array, near: float, rows: int, columns: int, screen: Array
) -> None:
    """Project vertices (V, 3) into a picture of so many rows and columns.

    axes    (3, 3): right and up, over half of the view at depth 1, and forward
    screen  (V, 3), output: column and row, whole numbers at the middle of subsamples, and one over the
            depth, 0 nearer than `near`
    """
    for v in range(vertices.shape[0]):
        x, y, z = vertices[v, 0] - origin[0], vertices[v, 1] - origin[1], vertices[v, 2] - origin[2]
        x, y, z = corner(x, y, z, axes)
        inverse = 1.0 / z if z > near else 0.0
        screen[v, 0] = (0.5 + 0.5 * x * inverse) * columns - 0.5
        screen[v, 1] = (0.5 - 0.5 * y * inverse) * rows - 0.5
        screen[v, 2] = inverse


@exact
def corner(x: float, y: float, z: float, axes: Array) -> tuple[float, float, float]:
    """Return the place of a vertex at an offset from the camera: x and y, from -1 to 1 across the picture
    (y up) times its depth, and the depth."""
    return (
        axes[0, 0] * x + axes[0, 1] * y + axes[0, 2] * z,
        axes[1, 0] * x + axes[1, 1] * y + axes[1, 2] * z,
        axes[2, 0] * x + axes[2, 1] * y + axes[2, 2] * z,
    )


@exact
def sort_faces(
    screen: Array, faces: Array, rows: int, columns: int, order: Array, corners: Array
) -> tuple[int, int, float, bool]:
    """Sort the faces (F, 3) that may be visible by the side they show.

    order    (F,), output: from its beginning faces that run counter-clockwise or cross the camera plane, from
             its end backwards those that run clockwise
    corners  (V,) uint8, 0 at first; output: bits SMALL and LARGE of vertices

    Returns both counts; a volume, above 0 if the faces of a closed surface face outwards; and True if no face
    crosses the camera plane. If one does, the volume means nothing.
    """
    front, back, volume, is_whole = 0, faces.shape[0], 0.0, True
    for f in range(faces.shape[0]):
        a, b, c = np.uint32(faces[f, 0]), np.uint32(faces[f, 1]), np.uint32(faces[f, 2])
        if not (screen[a, 2] > 0.0 and screen[b, 2] > 0.0 and screen[c, 2] > 0.0):
            is_whole = False
            if screen[a, 2] > 0.0 or screen[b, 2] > 0.0 or screen[c, 2] > 0.0:
                order[front] = f
                front += 1
                corners[a] |= LARGE
                corners[b] |= LARGE
                corners[c] |= LARGE
            continue
        ax, ay, bx, by = screen[a, 0], screen[a, 1], screen[b, 0], screen[b, 1]
        cx, cy = screen[c, 0], screen[c, 1]
        # above 0 if counter-clockwise, since rows go down
        area = (by - ay) * (cx - ax) - (bx - ax) * (cy - ay)
        volume += area * (screen[a, 2] + screen[b, 2] + screen[c, 2])
        left, right, top, bottom = box(ax, ay, bx, by, cx, cy, rows, columns)
        if left > right or top > bottom or area == 0.0:
            continue
        bits = LARGE if max(right - left, bottom - top) >= LARGE_SIZE else SMALL
        if area > 0.0:
            order[front] = f
            front += 1
        else:
            bits <<= CLOCKWISE
            back -= 1
            order[back] = f
        corners[a] |= bits
        corners[b] |= bits
        corners[c] |= bits
    return front, faces.shape[0] - back, volume, is_whole


@exact
def box(
    ax: float, ay: float, bx: float, by: float, cx: float, cy: float, rows: int, columns: int
) -> tuple[int, int, int, int]:
    """Return the first and last column and the first and last row whose middles a triangle may cover."""
    left, right = _ends(ax, bx, cx, columns)
    top, bottom = _ends(ay, by, cy, rows)
    return left, right, top, bottom


@exact
def _ends(a: float, b: float, c: float, count: int) -> tuple[int, int]:
    """Return the range of three numbers, clipped to 0 … count - 1; `min` and `max` would check for NaN."""
    low, high = (a, b) if a < b else (b, a)
    low, high = c if c < low else low, c if c > high else high
    begin, end = int(np.ceil(low)), int(np.floor(high))
    return begin if begin > 0 else 0, end if end < count else count - 1


Floats = NDArray[np.float64]


class Shape(NamedTuple):
    """A surface: vertices (V, 3), normals (V, 3), faces (F, 3) and its material.

    colours (V, 3) replace the material's colour (see `Material.vertex_colours`). Of a closed surface only
    faces towards the camera are drawn, which is faster. A pigment is drawn where there are rest positions
    (V, 3); previews show no relief and one roughness.
    """

    vertices: NDArray[np.floating]
    normals: NDArray[np.floating]
    faces: NDArray[np.int32]
    material: Material
    colours: Floats | None = None
    closed: bool = False
    rest: NDArray[np.floating] | None = None

    @classmethod
    def of(cls, surface: Surface, material: Material) -> Shape:
        """Return the shape of a surface in a material: with its pigment, or colours of its vertices."""
        mesh = surface.vertices, surface.normals, surface.faces
        if isinstance(material.pattern, Pigment):
            return cls(*mesh, material, rest=material.pattern.places(surface))
        return cls(*mesh, material, material.vertex_colours(surface))

    @property
    def pigment(self) -> Pigment | None:
        """The pigment that is drawn, or None."""
        pattern = self.material.pattern
        return pattern if self.rest is not None and isinstance(pattern, Pigment) else None

    def pigment_at(
        self, faces: NDArray[np.integer], screen: NDArray[np.float32], places: NDArray[np.floating]
    ) -> NDArray[np.float64]:
        """Return the colours (N, 3) of a pigment at columns and rows (N, 2) of the screen, on faces (N,).

        screen  (V, 3), as the kernel `project` computes it
        """
        assert self.rest is not None and self.pigment is not None, "has no pigment"
        points = np.empty((len(faces), 3))
        rest = np.ascontiguousarray(self.rest, np.float32)
        _points_at(self.faces, faces, screen, np.ascontiguousarray(places, np.float64), rest, points)
        return self.pigment.colours_at(points)

    def for_kernels(self) -> Shape:
        """Return the shape in single precision and C order."""
        vertices, normals = (np.ascontiguousarray(a, np.float32) for a in (self.vertices, self.normals))
        faces = np.ascontiguousarray(self.faces, np.int32)
        return self._replace(vertices=vertices, normals=normals, faces=faces)


@fast
def _points_at(
    faces: Array, which: Array, screen: Array, places: Array, values: Array, points: Array
) -> None:
    """Interpolate values (V, 3) of vertices at places (N, 2) of faces on the screen, into points (N, 3)."""
    for n in range(which.shape[0]):
        a, b, c = faces[which[n], 0], faces[which[n], 1], faces[which[n], 2]
        x, y = places[n, 0] - screen[c, 0], places[n, 1] - screen[c, 1]
        ax, ay = screen[a, 0] - screen[c, 0], screen[a, 1] - screen[c, 1]
        bx, by = screen[b, 0] - screen[c, 0], screen[b, 1] - screen[c, 1]
        area = ax * by - bx * ay
        u = v = w = 1.0
        if area != 0.0 and min(screen[a, 2], screen[b, 2], screen[c, 2]) > 0.0:  # it is before the camera
            u = min(max((x * by - bx * y) / area, 0.0), 1.0)
            v = min(max((ax * y - x * ay) / area, 0.0), 1.0)
            w = max(1.0 - u - v, 0.0)
            u, v, w = u * screen[a, 2], v * screen[b, 2], w * screen[c, 2]
        for k in range(3):
            points[n, k] = (u * values[a, k] + v * values[b, k] + w * values[c, k]) / (u + v + w)


@dataclass(frozen=True)
class StageSetup:
    """The lights, the stage and their placement, and the colour view.

    fades  True if the stage fades into the dark (`Stage.reflectances`)
    """

    lights: LightRig
    stage: Stage
    placement: StagePlacement
    view: ColourView = ACES
    fades: bool = False


class ScreenProjection(NamedTuple):
    """A camera for kernels: its position, its axes over half of the view at depth 1, its near distance."""

    origin: Floats
    axes: Floats
    near: float

    @classmethod
    def of(cls, camera: Camera, aspect: float) -> ScreenProjection:
        """Return the projection of a camera. aspect: width over height"""
        half = math.tan(camera.field_of_view / 2.0)
        return cls(np.array(camera.origin), camera.axes() / [[half], [half / aspect], [1.0]], camera.near)

    def project(self, vertices: NDArray[np.float32], rows: int, columns: int) -> NDArray[np.float32]:
        """Return screen coordinates (V, 3), as the kernel `project`."""
        screen = np.empty((len(vertices), 3), np.float32)
        project(vertices, *self, rows, columns, screen)
        return screen


@lru_cache(maxsize=4)
def stage_shapes(stage: Stage, placement: StagePlacement, fades: bool = False) -> tuple[Shape, ...]:
    """Return the backdrop, and what the subject stands on, in scene units. fades: as of `StageSetup`"""
    is_graded = fades or stage.is_graded
    material = coated(stage.colour, stage.coat, is_dark=not (is_graded or stage.finish))
    backdrop = Shape(*placement.placed(stage.backdrop()), material).for_kernels()
    if is_graded:
        backdrop = backdrop._replace(colours=stage.reflectances(fades).astype(np.float64))
    if (plinth := stage.plinth()) is None:
        return (backdrop,)
    material = coated(stage.plinth_colour, stage.plinth_coat, is_dark=not stage.plinth_finish)
    return backdrop, Shape(*placement.placed(plinth), material).for_kernels()


def coated(colour: Colour, roughness: float | None, is_dark: bool) -> Material:
    """Return a matt material, under a clear coat where there is a roughness of one.

    is_dark  True for a coat that darkens what is below; Mitsuba's does not where colours vary
    """
    if roughness is None:
        return Diffuse(colour)
    made = Plastic if is_dark else partial(Satin, coat=1.0)
    return made(colour, roughness=max(roughness, 0.02))


@lru_cache(maxsize=4)
def shading_props(stage: Stage, placement: StagePlacement) -> Shape | None:
    """Return what throws shadows besides the subject, scene units: a plinth, a window; None for none."""
    mesh = window_frame(WINDOWS[stage.kind]) if stage.kind in WINDOWS else stage.plinth()
    if mesh is None:
        return None
    return Shape(*placement.placed(mesh), Diffuse(stage.plinth_colour)).for_kernels()


@dataclass(frozen=True, eq=False)
class VisibleFaces:
    """A shape in a picture.

    screen    (V, 3), screen coordinates, as the kernel `project` computes them
    orders    arrays of indices of the faces that may be visible
    corners   (V,), bits SMALL and LARGE: which triangles a vertex is a corner of
    outwards  1 where faces that run counter-clockwise on the screen are the outer side of a closed surface,
              -1 where they are the inner side, 0 where both sides may be visible
    """

    shape: Shape
    screen: NDArray[np.float32]
    orders: tuple[NDArray[np.int32], ...]
    corners: NDArray[np.uint8]
    outwards: int

    @classmethod
    def of(cls, shape: Shape, projection: ScreenProjection, size: tuple[int, int]) -> VisibleFaces:
        """Find the faces of a shape that may be visible. size: rows and columns of the picture"""
        screen = projection.project(shape.vertices, *size)
        order, corners = np.empty(len(shape.faces), np.int32), np.zeros(len(screen), np.uint8)
        front, back, volume, is_whole = sort_faces(screen, shape.faces, *size, order, corners)
        counter_clockwise, clockwise = order[:front], order[len(order) - back :]
        if not (shape.closed and is_whole):
            both = corners | corners >> np.uint8(CLOCKWISE)
            return cls(shape, screen, (counter_clockwise, clockwise), both, 0)
        if volume > 0.0:
            return cls(shape, screen, (counter_clockwise,), corners, 1)
        return cls(shape, screen, (clockwise,), corners >> np.uint8(CLOCKWISE), -1)

    def corners_of(self, kind: int) -> NDArray[np.intp]:
        """Return the vertices (N,) that are corners of SMALL or LARGE triangles."""
        return np.flatnonzero(self.corners & kind)


SHARPNESS = (6.0, 160.0)
"""Least and greatest exponent of highlights at vertices: sharper ones fall between them, as dots."""

COAT = 0.04  # reflectance of a clear coat seen from straight above; its index of refraction is 1.5

_LEAVES_COAT, _RETURNS = 0.42, 0.6
"""Fraction of light that a coat of index 1.5 lets in and out again, and the fraction that it sends back from
inside to the body (Egan and Hilgeman 1973): a body under a coat is darker than its colour."""


class Reflectance(NamedTuple):
    """Weights of reflection, in the order in which the kernel `shade_vertices` reads them.

    body      of the colour, in all directions
    mirror    of the colour, in the mirror direction
    coat      reflectance of a clear coat seen from straight above
    grazing   its reflectance at a grazing angle
    exponent  of highlights (Blinn 1977)
    covered   share of what the coat reflects that the body lacks
    """

    body: float
    mirror: float
    coat: float
    grazing: float
    exponent: float
    covered: float = 1.0


def reflectance_of(material: Material, sharpness: tuple[float, float] = SHARPNESS) -> Reflectance:
    """Return the reflectance of a material. sharpness: the least and greatest exponent"""
    exponent = float(np.clip(2.0 / max(material.roughness, 0.02) ** 2 - 2.0, *sharpness))
    grazing = 1.0 - material.roughness
    match material:
        case Diffuse() | Smoke() | Gouraud():
            return Reflectance(1.0, 0.0, 0.0, 0.0, exponent)
        case Metal() | BrushedMetal():
            return Reflectance(0.0, 1.0, 0.0, 0.0, exponent)
        case Satin():
            coat = COAT * (1.0 - material.metallic)
            body, full = 1.0 - material.metallic, grazing * grazing
            return Reflectance(body, material.metallic, coat, full, exponent, covered=0.5)
    if material.is_clear:
        return Reflectance(0.0, 0.0, COAT, 1.0, exponent)
    return Reflectance(1.0, 0.0, COAT, max(grazing, COAT), exponent)


def body_colours(material: Material, colours: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the reflectances (N, 3) of bodies with these colours (N, 3): under a coat, less."""
    if not isinstance(material, Plastic):
        return colours
    return _LEAVES_COAT * colours / (1.0 - _RETURNS * colours)


def shadow_opacity(material: Material) -> float:
    """Return the fraction of the key light that a subject's shadow lacks."""
    return 1.0 - math.exp(-0.7 * material.density) if isinstance(material, Smoke) else 1.0


def contact_opacity(material: Material) -> float:
    """Return the fraction of light from above that a subject keeps from the floor where it touches it."""
    if isinstance(material, Smoke):
        return 0.5 * shadow_opacity(material)
    return 0.6 if material.is_clear else 1.0
