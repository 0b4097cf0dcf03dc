"""Quick pictures of a shot without a path tracer, and its flow drawn over them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray, Floats
from pipeline.errors import FrameError
from pipeline.mesh import icosphere
from pipeline.production.files import readers
from pipeline.production.files.store import CorruptFileError, Store
from pipeline.production.surfaces.framing import Framing
from pipeline.production.surfaces.movement import speeds
from pipeline.production.surfaces.shading import Shading
from pipeline.production.surfaces.ways import Ways, ways_at
from pipeline.production.takes.keys import Key
from pipeline.production.takes.take import Take
from render.colour import quantise
from render.dyes import colours
from render.image import write_png
from render.look import Look
from render.measure import SPEED
from render.movie import write_movie
from render.raster import Preview, Set, Shape, preview, with_lines
from render.surface import Surface

T = TypeVar("T")

SIZES = {"still": (960, 540), "movie": (480, 270)}

MOST_BALLS = 20_000
"""Points of a cloud that are drawn; where there are more, some of them, and larger."""

LINE = 1 / 600
"""How wide a streamline is, over the picture."""

SLOW, MIDDLE, FAST = (0.10, 0.36, 0.56), (0.86, 0.63, 0.16), (0.80, 0.24, 0.14)
"""Display values of the lines, from still to the fastest of them."""


@dataclass(frozen=True)
class Sketch:
    """Quick pictures of a take whose surfaces and cameras are in the store; `flow` draws streamlines."""

    take: Take
    store: Store
    flow: bool

    def place(self, number: int | None = None) -> Path:
        """Where a still is put, or the movie of the frames asked for."""
        name, mark = self.take.name, ".flow" if self.flow else ""
        whole = "" if self.take.is_whole else f".{min(self.take.requested)}-{max(self.take.requested)}"
        file = f"{name}{whole}{mark}.mp4" if number is None else f"{name}.{number:04d}{mark}.png"
        return self.take.folders.cameras().parent / "sketch" / file

    def still(self, number: int, path: Path) -> None:
        """Raises FrameError where the flow fails, RenderEnvironmentError where the disk does."""
        picture = self._picture(number, self._framings()[number], SIZES["still"], "srgb")
        write_png(path, quantise(picture), {"shot": self.take.name, "frame": number})

    def movie(self, path: Path) -> int:
        """Raises as `still`; returns how many frames it has."""
        framings = self._framings()

        def pictures() -> Iterator[NDArray[Any]]:
            for number in sorted(self.take.requested):
                yield quantise(self._picture(number, framings[number], SIZES["movie"], "rec709"))

        return write_movie(path, pictures(), self.take.shot.rate.fps)

    def _framings(self) -> Mapping[int, Framing]:
        found = self.take.framings(self.store)
        assert found is not None, "the plan has made them"
        return found

    def _picture(
        self, number: int, framing: Framing, size: tuple[int, int], display: str
    ) -> NDArray[np.float32]:
        key = self.take.normals_key(number)
        arrays = self._read("normals", key, number, readers.arrays(key))
        picture = self.take.shot.picture
        brought = {SPEED: self._speeds(number)} if self.take.measures_speed else {}
        subject = _shape(arrays, picture.look, brought)
        around = Set(picture.lights, picture.stage, framing.placement, picture.view)
        shown: Preview = preview(subject, around, framing.camera, size, display)
        if not self.flow:
            return shown.picture
        ways = ways_at(self.take.shot.motion, number, arrays["vertices"].astype(np.float64))
        return with_lines(shown, ways.points, *inks(ways), framing.camera, max(1.0, LINE * size[0]))

    def _speeds(self, number: int) -> AnyArray:
        """(V, 1) of the vertices of a frame's pictures."""
        key = self.take.mesh_key(number)
        frame = self._read("mesh", key, number, readers.mesh_frame(key))
        shot = self.take.shot
        shading = Shading.of(frame, self.take.thresholds(number), shot.picture.tessellate)
        return speeds(shot.motion, shading)

    def _read(self, kind: str, key: Key, number: int, reader: Callable[[Path], T]) -> T:
        """A stored file. A corrupt one is forgotten, so that the next run makes it anew."""
        try:
            return reader(self.store.path(kind, key))
        except (CorruptFileError, FileNotFoundError) as error:
            self.store.discard(kind, key)
            place = self.take.place(kind, number)
            raise FrameError(f"{place} cannot be read to its end; run again to make it anew") from error


def _shape(arrays: Mapping[str, AnyArray], look: Look, brought: Mapping[str, AnyArray]) -> Shape:
    """What pictures of a frame are made from, as a shape; of a cloud a small ball for each point.

    brought: attributes of the points, by name
    """
    vertices, none = arrays["vertices"], np.empty((0, 3), np.int32)
    normals, faces = arrays.get("normals", vertices), arrays.get("faces", none)
    shown = colours(Surface(vertices, normals, faces, brought, arrays["material"]), look)
    if "radii" not in arrays:
        return Shape(vertices, normals, faces, look, shown)
    every = -(-len(arrays["vertices"]) // MOST_BALLS)
    points, radii = arrays["vertices"][::every], arrays["radii"][::every] * every ** (1 / 3)
    ball = icosphere(2)
    around, many = ball.vertices, len(ball.vertices)
    vertices = (points[:, None] + radii[:, None, None] * around).reshape(-1, 3)
    faces = (ball.faces + many * np.arange(len(points), dtype=np.int32)[:, None, None]).reshape(-1, 3)
    shaded = None if shown is None else shown[::every].repeat(many, axis=0)
    return Shape(vertices, np.tile(around, (len(points), 1)), faces.astype(np.int32), look, shaded)


def inks(ways: Ways) -> tuple[Floats, Floats]:
    """Colours (N, K, 3) by speed, and opacity (N, K) that fades at both ends."""
    fast = float(np.quantile(ways.speeds, 0.95)) if ways.speeds.size else 1.0
    share = np.clip(ways.speeds / max(fast, 1e-300), 0.0, 1.0)
    stops = np.array([SLOW, MIDDLE, FAST])
    colours = np.stack([np.interp(share, (0.0, 0.5, 1.0), stops[:, k]) for k in range(3)], axis=-1)
    along = np.linspace(0.0, np.pi, ways.speeds.shape[1])
    return colours, np.clip(np.sin(along), 0.0, 1.0)[None] ** 0.7 * (0.4 + 0.55 * share)
