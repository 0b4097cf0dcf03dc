"""Clear subjects in quick previews: glass, honey and smoke let the stage behind them be seen.

The stage is drawn first. Of the subject its normals are drawn, and its thickness along each line of sight: by
it light is absorbed or scattered. Every face adds its depth where it turns away from the eye and takes it off
where it turns to it, whatever the order of faces; what is left is the length of all parts of the line inside
the surface. Glass shifts what is behind it, as a ball of its refraction does, and rough glass blurs it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.raster.lighting import Lighting, table_place, table_value
from flowsculpt.render.raster.raster_shapes import Array, Floats, ScreenProjection, Shape, exact, fast
from flowsculpt.render.raster.triangles import SUPERSAMPLING, WHITE, Subsamples
from flowsculpt.render.scene.materials import Glass, Material, Smoke

GRID = 256  # steps of corners within a pixel: on a grid, neighbours share no pixel and leave none out


class VisiblePoints(NamedTuple):
    """The pixels in which a subject is visible.

    pixels    (N, 2), rows and columns
    coverage  (N,), the fraction of the pixel that the subject covers
    depth     (N,)
    points    (N, 3), scene units
    normals   (N, 3)
    """

    pixels: NDArray[np.int32]
    coverage: NDArray[np.float32]
    depth: NDArray[np.float32]
    points: NDArray[np.float32]
    normals: NDArray[np.float32]

    @classmethod
    def of(
        cls, drawn: Subsamples, behind: NDArray[np.float32], projection: ScreenProjection
    ) -> VisiblePoints:
        """Find them in a picture of the subject's normals, from 0 to 1. behind: the nearness without it"""
        most = drawn.nearness.size // SUPERSAMPLING**2
        pixels, vectors = np.empty((most, 2), np.int32), np.empty((2, most, 3), np.float32)
        found = cls(pixels, *np.empty((2, most), np.float32), *vectors)
        axes = projection.axes / np.sum(projection.axes**2, axis=1, keepdims=True)
        count = find_visible(drawn.nearness, behind, drawn.colour, projection.origin, axes, found)
        return cls._make(values[:count] for values in found)


@fast
def pack_normals(normals: Array, sign: float, packed: Array) -> None:
    """Write unit normals (V, 3), times a sign, as values from 0 to 1 into packed (V, 3)."""
    for v in range(normals.shape[0]):
        x, y, z = normals[v, 0], normals[v, 1], normals[v, 2]
        scale = 0.5 * sign / math.sqrt(max(x * x + y * y + z * z, 1e-12))
        packed[v, 0], packed[v, 1], packed[v, 2] = 0.5 + scale * x, 0.5 + scale * y, 0.5 + scale * z


@exact
def find_visible(
    nearness: Array, behind: Array, packed: Array, origin: Array, axes: Array, found: VisiblePoints
) -> int:
    """Write the points of a subject, and return their number.

    axes  (3, 3): half of what the lens sees at depth 1 to the right and upwards, and forward
    """
    pixels, coverage, depth, points, normals = found
    rows, columns = nearness.shape[0] // SUPERSAMPLING, nearness.shape[1] // SUPERSAMPLING
    count = 0
    for i in range(rows):
        for j in range(columns):
            hits, near, x, y, z = 0, 0.0, 0.0, 0.0, 0.0
            for s in range(SUPERSAMPLING * SUPERSAMPLING):
                row, column = SUPERSAMPLING * i + s // SUPERSAMPLING, SUPERSAMPLING * j + s % SUPERSAMPLING
                if nearness[row, column] > behind[row, column]:
                    hits += 1
                    near += nearness[row, column]
                    value = packed[row, column]
                    x += value >> np.uint32(20)
                    y += value >> np.uint32(10) & np.uint32(1023)
                    z += value & np.uint32(1023)
            if hits == 0:
                continue
            pixels[count, 0], pixels[count, 1] = i, j
            coverage[count] = hits / (SUPERSAMPLING * SUPERSAMPLING)
            depth[count] = hits / near
            x, y, z = x / hits - WHITE / 2.0, y / hits - WHITE / 2.0, z / hits - WHITE / 2.0
            scale = 1.0 / math.sqrt(max(x * x + y * y + z * z, 1e-12))
            normals[count, 0], normals[count, 1], normals[count, 2] = x * scale, y * scale, z * scale
            right, up = (2 * j + 1) / columns - 1.0, 1.0 - (2 * i + 1) / rows
            for k in range(3):
                ray = right * axes[0, k] + up * axes[1, k] + axes[2, k]
                points[count, k] = origin[k] + depth[count] * ray
            count += 1
    return count


@exact
def add_thickness(faces: Array, screen: Array, outwards: int, thickness: Array, layers: Array) -> None:
    """Add the depth behind faces (F, 3) at the middle of pixels, into thickness (H, W).

    screen    (V, 3), as `project` computes them
    outwards  as in `VisibleFaces`, 1 or -1
    layers    (H, W, 2) int32: the faces that turn to the eye, and those that turn away

    Faces that cross the camera plane are left out.
    """
    rows, columns = thickness.shape
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        if not (screen[a, 2] > 0.0 and screen[b, 2] > 0.0 and screen[c, 2] > 0.0):
            continue
        ax, ay = _on_grid(screen[a, 0]), _on_grid(screen[a, 1])
        bx, by = _on_grid(screen[b, 0]), _on_grid(screen[b, 1])
        cx, cy = _on_grid(screen[c, 0]), _on_grid(screen[c, 1])
        area = (by - ay) * (cx - ax) - (bx - ax) * (cy - ay)
        if area == 0:
            continue
        side = 0 if (area > 0) == (outwards > 0) else 1
        if area < 0:  # the other way round, the edges have one sense of rotation
            b, c, bx, by, cx, cy, area = c, b, cx, cy, bx, by, -area
        left, right = max(0, -(-min(ax, bx, cx) // GRID)), min(columns - 1, max(ax, bx, cx) // GRID)
        top, bottom = max(0, -(-min(ay, by, cy) // GRID)), min(rows - 1, max(ay, by, cy) // GRID)
        sign = -1.0 if side == 0 else 1.0
        for i in range(top, bottom + 1):
            y = GRID * i
            for j in range(left, right + 1):
                x = GRID * j
                u = (cy - by) * (x - bx) - (cx - bx) * (y - by)
                v = (ay - cy) * (x - cx) - (ax - cx) * (y - cy)
                w = (by - ay) * (x - ax) - (bx - ax) * (y - ay)
                if (
                    (u > 0 or (u == 0 and _owns(cx - bx, cy - by)))
                    and (v > 0 or (v == 0 and _owns(ax - cx, ay - cy)))
                    and (w > 0 or (w == 0 and _owns(bx - ax, by - ay)))
                ):
                    nearness = (u * screen[a, 2] + v * screen[b, 2] + w * screen[c, 2]) / area
                    thickness[i, j] += sign / nearness
                    layers[i, j, side] += 1


@exact
def _on_grid(place: float) -> int:
    """Return a row or column of subsamples on the grid, where multiples of GRID are the middles of pixels."""
    middle = 0.5 * (SUPERSAMPLING - 1)
    return round((float(place) - middle) / SUPERSAMPLING * GRID)


@exact
def _owns(dx: int, dy: int) -> bool:
    """Tell whether a point on an edge belongs to the triangle on this side of it; the other one says no."""
    return dy > 0 or (dy == 0 and dx > 0)


SHARPNESS = (6.0, 400.0)  # least and greatest exponent of highlights: they are computed for each pixel
TOE, STOPS = 2.0**-8, 14.0  # linear light is packed as log2(1 + light / TOE) / STOPS
_STEEPEST = 2.0  # largest tangent of the angle by which glass bends a line of sight
_BEHIND = 1.5  # distance of the stage behind the subject, in halves of its size
_THICK = 0.4  # thickness from which glass bends as much as a ball, in halves of the subject's size
_ASIDE = 1.4  # rate at which surrounding light replaces that of the picture, by the sine of glass's bend
_DETOUR = 1.3  # length of light's way inside glass, over the thickness: it is reflected and bent there
_FORWARD = 0.15  # weight of the light on the near side of dense smoke, over that on both sides


class ClearBody(NamedTuple):
    """The optical properties of a clear material.

    tint        (3,), transmitted by each pair of surfaces
    rate        (3,), absorbed or scattered, per scene unit
    refraction  index of refraction; 1 for smoke, which has no surface
    """

    tint: Floats
    rate: Floats
    refraction: float

    @classmethod
    def of(cls, material: Material, size: float) -> ClearBody:
        """Return the properties of a material. size: half the subject's, scene units"""
        if isinstance(material, Smoke):
            return cls(np.ones(3), np.full(3, material.density / size), 1.0)
        if isinstance(material, Glass):
            rate = np.array(material.absorption.rate if material.absorption else (0.0, 0.0, 0.0))
            return cls(np.array(material.colour) ** 2, rate / size, material.refraction)
        return cls(np.array(material.colour), np.zeros(3), 1.5)


def seen_through(
    points: VisiblePoints,
    shape: Shape,
    lighting: Lighting,
    axes: Floats,
    thickness: NDArray[np.float32],
    layers: NDArray[np.int32],
    background: NDArray[np.float32],
) -> NDArray[np.float32]:
    """Return the linear light (N, 3) of a clear subject.

    axes               as of `ScreenProjection`
    thickness, layers  as `add_thickness` computes them
    background         (H, W, 3), the linear light of the stage
    """
    material, size = shape.material, lighting.setup.placement.size
    roughness = material.roughness if isinstance(material, Glass) else 0.0
    across = float(np.linalg.norm(axes[0]) * points.depth.mean()) if len(points.depth) else 1.0
    reach = roughness * _BEHIND * size / across / 2.0
    surface = _surface_light(points, material, lighting)
    light = np.empty_like(surface)
    mix_light(
        points,
        axes,
        thickness,
        layers,
        _blur(background, round(reach * background.shape[1])),
        surface,
        ClearBody.of(material, size),
        lighting.mirrored(roughness),
        lighting.contact.frame[4:],
        size,
        light,
    )
    return light


def _blur(picture: NDArray[np.float32], reach: int) -> NDArray[np.float32]:
    """Return a picture (H, W, 3) whose pixels are means over squares of 2 reach + 1 pixels."""
    for axis in (0, 1) if reach > 0 else ():
        sides = [(reach + 1, reach) if side == axis else (0, 0) for side in range(3)]
        sums = np.pad(picture, sides, mode="edge").cumsum(axis=axis, dtype=np.float64)
        first, last = sums.take(range(picture.shape[axis]), axis), np.split(sums, [2 * reach + 1], axis)[1]
        picture = ((last - first) / (2 * reach + 1)).astype(np.float32)
    return picture


def _surface_light(points: VisiblePoints, material: Material, lighting: Lighting) -> NDArray[np.float32]:
    """Return the light (N, 3) that the surface reflects, or that smoke scatters to the eye."""
    which, no_faces = np.arange(len(points.points)), np.empty((0, 3), np.int32)
    near = Shape(points.points, points.normals, no_faces, material)
    if not isinstance(material, Smoke):
        return np.ascontiguousarray(lighting.shade(near, which, 0, sharpness=SHARPNESS)[:, :3])
    front = lighting.shade(near, which, 1)[:, :3]
    back = lighting.shade(near._replace(normals=-points.normals), which, 1)[:, :3]
    return np.asarray((0.5 + _FORWARD) * front + (0.5 - _FORWARD) * back)


@fast
def pack_light(light: Array, packed: Array) -> None:
    """Write linear light (N, 3) as values from 0 to 1 into packed (N, 3)."""
    scale = 1.0 / (STOPS * math.log(2.0))
    for n in range(light.shape[0]):
        for k in range(3):
            packed[n, k] = min(math.log(1.0 + max(light[n, k], 0.0) / TOE) * scale, 1.0)


@fast
def unpack_light(packed: Array, light: Array) -> None:
    """Write the linear light of packed values (H, W, 3) into light (H, W, 3)."""
    scale = np.float32(STOPS * math.log(2.0))
    for i in range(packed.shape[0]):
        for j in range(packed.shape[1]):
            for k in range(3):
                light[i, j, k] = np.float32(TOE) * (math.exp(packed[i, j, k] * scale) - np.float32(1.0))


@fast
def mix_light(
    points: VisiblePoints,
    axes: Array,
    thickness: Array,
    layers: Array,
    background: Array,
    surface: Array,
    body: ClearBody,
    around: Array,
    turn: Array,
    size: float,
    light: Array,
) -> None:
    """Add what is behind a clear body to the light of its surface (N, 3), into light (N, 3).

    axes    as of `ScreenProjection`
    around  the table `Surroundings.mirrored` of a smooth mirror: what glass shows that bends a line of sight
            far aside
    turn    (2,), cosine and sine of the stage's turn
    size    half the subject's, scene units
    """
    pixels, depth, normals = points.pixels, points.depth, points.normals
    tint, rate, refraction = body
    rows, columns = thickness.shape
    across = math.sqrt(axes[0, 0] ** 2 + axes[0, 1] ** 2 + axes[0, 2] ** 2)
    upwards = math.sqrt(axes[1, 0] ** 2 + axes[1, 1] ** 2 + axes[1, 2] ** 2)
    opaque = np.empty(3)
    for k in range(3):
        opaque[k] = -math.log(max(tint[k], 1e-6))
    for p in range(pixels.shape[0]):
        i, j = pixels[p, 0], pixels[p, 1]
        long, front = 0.0, max(layers[i, j, 0], 1)
        if layers[i, j, 0] == layers[i, j, 1]:
            long = max(thickness[i, j], 0.0)
        row, column, way, lets_pass, aside = float(i), float(j), long, 1.0, 0.0
        a, b, a_weight, b_weight = 0, 0, 0.0, 0.0
        if refraction > 1.0:
            x, y, z = normals[p, 0], normals[p, 1], normals[p, 2]
            right = (axes[0, 0] * x + axes[0, 1] * y + axes[0, 2] * z) / across
            up = (axes[1, 0] * x + axes[1, 1] * y + axes[1, 2] * z) / upwards
            squared = min(right * right + up * up, 0.998)
            cosine, inside = math.sqrt(1.0 - squared), math.sqrt(1.0 - squared / (refraction * refraction))
            sine = math.sqrt(max(squared, 1e-12))
            # a ball bends a line of sight by twice the angle between the line outside and the line inside
            tangent = sine * (inside - cosine / refraction) / (cosine * inside + squared / refraction)
            tangent *= min(long / (_THICK * size), 1.0)
            along = (1.0 - tangent * tangent) / (1.0 + tangent * tangent)
            across_by = 2.0 * tangent / (1.0 + tangent * tangent)
            aside = min(_ASIDE * across_by, 1.0)
            u, v = -across_by * right / (sine * across), -across_by * up / (sine * upwards)
            x = along * axes[2, 0] + u * axes[0, 0] + v * axes[1, 0]
            y = along * axes[2, 1] + u * axes[0, 1] + v * axes[1, 1]
            z = along * axes[2, 2] + u * axes[0, 2] + v * axes[1, 2]
            x, z = turn[0] * x - turn[1] * z, turn[1] * x + turn[0] * z
            a, b, a_weight, b_weight = table_place(x, y, z)
            shift = min(2.0 * tangent / max(1.0 - tangent * tangent, 0.1), _STEEPEST)
            shift *= _BEHIND * size / (depth[p] * sine)
            column -= 0.5 * columns * across * shift * right
            row += 0.5 * rows * upwards * shift * up
            way = _DETOUR * long
            lets_pass = (0.96 - 0.96 * (1.0 - cosine) ** 5) ** 2
        row, column = min(max(row, 0.0), rows - 1.001), min(max(column, 0.0), columns - 1.001)
        m, n = int(row), int(column)
        down, beside = row - m, column - n
        for k in range(3):
            near = background[m, n, k] + beside * (background[m, n + 1, k] - background[m, n, k])
            far = background[m + 1, n, k] + beside * (background[m + 1, n + 1, k] - background[m + 1, n, k])
            passed = lets_pass * math.exp(-rate[k] * way - front * opaque[k])
            own = surface[p, k] if refraction > 1.0 else (1.0 - passed) * surface[p, k]
            behind = near + down * (far - near)
            if aside > 0.0:
                behind += aside * (table_value(around, a, b, a_weight, b_weight, k) - behind)
            light[p, k] = own + passed * behind


@fast
def lay_over(pixels: Array, coverage: Array, shown: Array, picture: Array) -> None:
    """Mix the display values (N, 3) of pixels into a picture (H, W, 3) by their coverage (N,)."""
    for p in range(pixels.shape[0]):
        i, j = pixels[p, 0], pixels[p, 1]
        for k in range(3):
            picture[i, j, k] += coverage[p] * (shown[p, k] - picture[i, j, k])
