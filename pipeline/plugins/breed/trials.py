"""Trials: a candidate moved on a coarser mesh, drawn small, and measured.

Nothing here depends on time, threads or other candidates: equal shots give equal trials, to the bit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from flowsculpt import Curvature, FrameError, icosphere
from flowsculpt.api.flows import MotionForecast
from flowsculpt.api.frames import BoundingSpheres, Framer, Framing, MeshFrame, Shading, animate
from flowsculpt.api.materials import Surface
from flowsculpt.api.meshes import Floats
from flowsculpt.api.pictures import Shape, draw_preview
from flowsculpt.api.shots import Motion, Shot

Extent = np.ndarray | BoundingSpheres
"""Points (N, 3), or spheres, that a picture shows."""

SHOWN = 9
"""Pictures of a trial, at equal distances up to the last frame."""

PIXELS = 320 * 180
"""Pixels of each picture, about, whatever its aspect."""

COARSER = 1.3
"""Edge lengths of a trial over those of the shot."""

MOST_GROWTH = 14.0
"""Vertices over those of the first frame from which on a candidate explodes."""

MOST_VERTICES = 150_000
"""Vertices at which a trial stops: it would take too long."""

MOST_BALLS = 4000
"""Points of a cloud that are drawn; of more a part is drawn, with larger balls."""

GRID = (32, 18)
"""Columns and rows of the grid on which silhouettes are compared."""

SAMPLE = 4000
"""Vertices by which movement is measured."""

MOST_MOVES = 4e8
"""Sub-steps of vertices from which on a trial would take too long, half a minute."""


@dataclass(frozen=True, eq=False)
class Trial:
    """Pictures and measures of a candidate.

    pictures   uint8 (SHOWN, H, W, 3)
    shapes     float32 (SHOWN, rows, columns): share of each cell of GRID that the subject covers, 0 or 1
    growth     most vertices over those of the first frame
    inside     least share of vertices within the picture
    covered    share of the picture that the subject covers, in each picture
    change     how far the surface leaves its form at rest, in each picture: the distance of points from where
               the nearest similarity transform takes them, over the size at rest
    """

    pictures: NDArray[np.uint8]
    shapes: NDArray[np.float32]
    growth: float
    inside: float
    covered: Floats
    change: Floats

    def arrays(self) -> dict[str, np.ndarray]:
        """Return all as named arrays, from which `of` makes the same."""
        return {field.name: np.asarray(getattr(self, field.name)) for field in fields(self)}

    @classmethod
    def of(cls, arrays: Mapping[str, np.ndarray]) -> Trial:
        """Return the trial that `arrays` describes.

        Raises KeyError where one is missing, TypeError or ValueError for one of another shape or kind.
        """
        growth, inside = float(arrays["growth"]), float(arrays["inside"])
        pictures, shapes, covered, change = (
            arrays[name] for name in ("pictures", "shapes", "covered", "change")
        )
        own = pictures.dtype == np.uint8 and pictures.ndim == 4 and pictures.shape[::3] == (SHOWN, 3)
        if not own or shapes.shape != (SHOWN, *GRID[::-1]) or {covered.shape, change.shape} != {(SHOWN,)}:
            raise ValueError("these are not the arrays of a trial")
        return cls(pictures, shapes, growth, inside, covered, change)


def tried(shot: Shot) -> Trial:
    """Move and draw a candidate. Raises FrameError where a flow fails, explodes or would take too long."""
    motions = [_coarser(part.motion) for part in shot.parts]
    numbers = list(shot.frames)
    shown = [numbers[round(k * (len(numbers) - 1) / SHOWN)] for k in range(1, SHOWN + 1)]
    extents: list[list[Extent]] = [[] for _ in numbers]
    kept: dict[int, list[MeshFrame]] = {number: [] for number in shown}  # fewer in a very short shot
    growth = 1.0
    for motion in motions:
        first = 0
        for index, frame in enumerate(animate(motion)):
            points = frame.mesh.vertices.astype(np.float32)
            if not first:
                first = len(points)
                _require_speed(motion, frame.mesh.vertices)
            growth = max(growth, len(points) / first)
            extents[index].append(BoundingSpheres(points, frame.radii) if frame.is_cloud else points)
            if frame.number in kept:
                kept[frame.number].append(frame)
    framings = _framings(shot, numbers, [BoundingSpheres.join(each) for each in extents])
    return _drawn(shot, motions, kept, framings, growth, [[*kept].index(number) for number in shown])


def _require_speed(motion: Motion, points: Floats) -> None:
    """Raise FrameError where the sub-steps of a frame in the middle would take too long in all frames."""
    numbers = list(motion.frames)
    costs = MotionForecast(motion).costs(numbers[len(numbers) // 2], points) if len(numbers) > 1 else ()
    if costs and costs[0].substeps * len(points) * len(numbers) > MOST_MOVES:
        raise FrameError(str(costs[0]), numbers[len(numbers) // 2])


def _coarser(motion: Motion) -> Motion:
    """Return a motion with longer edges and vertices in their middles, which takes a quarter of the time."""
    resampling = motion.resampling
    if resampling is None:
        return motion
    thresholds = resampling.thresholds
    longest = thresholds.max_edge_length
    if isinstance(longest, float):
        longest = COARSER * longest
    elif isinstance(longest, Curvature):
        finest, coarsest = COARSER * longest.finest, COARSER * longest.coarsest
        longest = replace(longest, tolerance=COARSER**2 * longest.tolerance, finest=finest, coarsest=coarsest)
    coarse = replace(thresholds, max_edge_length=longest, min_edge_length=None, max_vertices=MOST_VERTICES)
    return replace(
        motion,
        resampling=replace(
            resampling,
            thresholds=coarse,
            method="triangles",
            placement="chord",
            splits="edges",
            max_growth=MOST_GROWTH,
        ),
    )


def _framings(shot: Shot, numbers: Sequence[int], extents: Sequence[Extent]) -> dict[int, Framing]:
    picture = shot.picture
    camera, stage = picture.camera, picture.stage
    aspect = picture.qualities["final"].aspect
    views = [camera.at(shot.motion.clock.time(number)) for number in numbers]
    framed = Framer(views, lambda i: extents[i], aspect, camera.follow).all()
    flat = None if camera.projection.is_wide else aspect
    return {n: each.with_stage_in_view(stage, flat) for n, each in zip(numbers, framed, strict=True)}


def _drawn(
    shot: Shot,
    motions: Sequence[Motion],
    kept: Mapping[int, Sequence[MeshFrame]],
    framings: Mapping[int, Framing],
    growth: float,
    order: Sequence[int],
) -> Trial:
    """Draw and measure the frames that are kept, and return those with the indices `order`."""
    aspect = shot.picture.qualities["final"].aspect
    height = (PIXELS / aspect) ** 0.5
    size = 2 * max(1, round(height * aspect / 2)), 2 * max(1, round(height / 2))
    pictures, shapes, insides, changes = [], [], [], []
    for number, frames in kept.items():
        framing = framings[number]
        pictures.append(_picture(shot, motions, frames, framing, size))
        points = np.concatenate([frame.mesh.vertices for frame in frames])
        seen = framing.camera.project(points, aspect)
        inside = np.abs(seen[:, :2]).max(axis=1) <= 1.0
        insides.append(float(inside.mean()))
        shapes.append(_silhouette(seen[inside, :2]))
        changes.append(max(_change(frame) for frame in frames))
    covered = np.array([shapes[k].mean() for k in order], np.float64)
    change = np.array([changes[k] for k in order], np.float64)
    drawn, outlines = np.stack([pictures[k] for k in order]), np.stack([shapes[k] for k in order])
    return Trial(drawn, outlines, growth, min(insides), covered, change)


def _picture(
    shot: Shot,
    motions: Sequence[Motion],
    frames: Sequence[MeshFrame],
    framing: Framing,
    size: tuple[int, int],
) -> NDArray[np.uint8]:
    """Draw a frame, uint8 (H, W, 3)."""
    shapes = [
        _shape(part, motion, frame) for part, motion, frame in zip(shot.parts, motions, frames, strict=True)
    ]
    return draw_preview(shapes, shot.picture, framing, size)


def _shape(part: Shot, motion: Motion, frame: MeshFrame) -> Shape:
    look = part.picture.look
    shading = Shading.of(frame, motion.thresholds_at(frame.number), max(1, min(2, part.picture.tessellate)))
    arrays: dict[str, np.ndarray] = shading.arrays()
    pattern = look.pattern
    attributes = motion.copy_places(pattern, arrays["material"].astype(np.float64))
    if look.measures_speed:
        attributes[Surface.SPEED] = shading.speeds(motion)
    if Surface.VALUES in arrays:
        attributes[Surface.VALUES] = arrays[Surface.VALUES]
    vertices = arrays["vertices"]
    if "radii" in arrays:
        vertices, arrays, attributes = _balls(arrays, attributes)
    faces, material = arrays["faces"], arrays["material"]
    paint = motion.painted(material.astype(np.float64), faces) if look.shows_paint else None
    surface = Surface(vertices, arrays["normals"], faces, attributes, material, paint=paint)
    return Shape.of(surface, look)


def _balls(
    arrays: Mapping[str, np.ndarray], attributes: Mapping[str, np.ndarray]
) -> tuple[np.ndarray, dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Return the vertices, arrays and attributes of a small ball for each point of a cloud, or of a part."""
    ball = icosphere(1)
    count, normals = len(ball.vertices), ball.vertices / np.linalg.norm(ball.vertices, axis=1)[:, None]
    step = -(-len(arrays["vertices"]) // MOST_BALLS)
    points, sizes = arrays["vertices"][::step], arrays["radii"][::step] * step ** (1 / 3)
    vertices = (points[:, None] + sizes[:, None, None] * ball.vertices).reshape(-1, 3).astype(np.float32)
    faces = (ball.faces + count * np.arange(len(points), dtype=np.int32)[:, None, None]).reshape(-1, 3)
    spread = {name: values[::step].repeat(count, axis=0) for name, values in attributes.items()}
    of_ball = {"normals": np.tile(normals, (len(points), 1)).astype(np.float32), "faces": faces}
    return vertices, {**of_ball, "material": arrays["material"][::step].repeat(count, axis=0)}, spread


def _silhouette(seen: Floats) -> NDArray[np.float32]:
    """Return 1 for each cell (rows, columns) of GRID in which a vertex is seen at (N, 2), −1 … 1; else 0."""
    columns, rows = GRID
    places = np.clip((seen * (0.5, -0.5) + 0.5) * (columns, rows), 0, (columns - 1, rows - 1)).astype(int)
    shape = np.zeros((rows, columns), np.float32)
    shape[places[:, 1], places[:, 0]] = 1.0
    return shape


def _change(frame: MeshFrame) -> float:
    """Return how far a surface is from any similar form of itself at rest (Umeyama 1991), over its size."""
    step = max(1, len(frame.mesh.vertices) // SAMPLE)
    now, rest = frame.mesh.vertices[::step], np.asarray(frame.material, np.float64)[::step]
    now, rest = now - now.mean(axis=0), rest - rest.mean(axis=0)
    left, values, right = np.linalg.svd(now.T @ rest)
    values[-1] *= np.sign(np.linalg.det(left @ right))
    spread = float((rest**2).sum())
    if spread == 0.0:
        return 0.0
    turned = rest @ right.T * np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ left.T
    off = now - (values.sum() / spread) * turned
    return float(np.sqrt((off**2).sum() / spread))
