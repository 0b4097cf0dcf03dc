"""The canvas of a quick preview, and the drawing of lit shapes into it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from render.post.colour import to_display
from render.post.view import ColourView
from render.raster.contact import LOOKS_DARK, PACKED_DARK, ContactShadow
from render.raster.key_light import ShadowMap
from render.raster.large_triangles import SUPERSAMPLING, LargeTriangles
from render.raster.lighting import Lighting, apply_shadow, floor_light
from render.raster.raster_projection import LARGE, SMALL
from render.raster.raster_shapes import ScreenProjection, StageSetup, VisibleFaces
from render.raster.see_through import pack_light
from render.raster.triangles import average, draw_triangles, pack
from render.raster.visible_points import pack_normals
from render.scene.render_camera import Camera
from render.scene.scene_lights import LightRig
from render.scene.scene_stage import Stage, StagePlacement


@dataclass(frozen=True, eq=False)
class Canvas:
    """A picture to draw shapes into, SUPERSAMPLING times as fine as the result.

    display                     of its values; empty for packed linear light
    nearness, colour, face_ids  as the kernel `draw_triangles` takes them
    """

    projection: ScreenProjection
    lighting: Lighting
    setup: StageSetup
    display: str
    nearness: NDArray[np.float32]
    colour: NDArray[np.uint32]
    face_ids: NDArray[np.int32]

    @classmethod
    def of(
        cls,
        camera: Camera,
        setup: StageSetup,
        contact: ContactShadow,
        size: tuple[int, int],
        display: str,
        has_face_ids: bool,
    ) -> Canvas:
        width, height = size
        shape = SUPERSAMPLING * height, SUPERSAMPLING * width
        horizon = (0.0, 0.0, 0.0) if setup.fades else setup.lights.sky.horizon
        background = _values(np.array([horizon], np.float32), setup, display)[0]
        return cls(
            ScreenProjection.of(camera, width / height),
            Lighting.of(setup, contact, camera),
            setup,
            display,
            np.zeros(shape, np.float32),
            np.full(shape, pack(*background), np.uint32),
            np.full(shape if has_face_ids else (0, 0), -1, np.int32),
        )

    def draw(self, faces: VisibleFaces, shadow: ShadowMap, first_id: int = 0, is_stage: bool = False) -> None:
        """Draw triangles with hidden surfaces removed. first_id: id of the shape's first face"""
        colours = self._vertex_colours(faces, shadow, is_stage)
        self._draw(faces, colours, self._large_triangles(faces, shadow, is_stage), first_id)

    def draw_normals(self, faces: VisibleFaces, shadow: ShadowMap) -> None:
        """Draw the normals of a shape, from 0 to 1 along each axis, in place of light."""
        values = np.empty_like(faces.shape.normals)
        pack_normals(faces.shape.normals, -1.0 if faces.outwards < 0 else 1.0, values)
        large = self._large_triangles(faces, shadow, False)
        if len(large.values):
            large.values[:, :6] = np.tile(values, 2)
        self._draw(faces, values, large._replace(opacity=0.0), 0)

    def _draw(
        self, faces: VisibleFaces, colours: NDArray[np.float32], large: LargeTriangles, first_id: int
    ) -> None:
        for order in faces.orders:
            draw_triangles(
                order,
                faces.shape.faces,
                first_id,
                faces.screen,
                colours,
                large,
                self.nearness,
                self.colour,
                self.face_ids,
            )

    def _vertex_colours(self, faces: VisibleFaces, shadow: ShadowMap, is_stage: bool) -> NDArray[np.float32]:
        """Return display values (V, 3) of the corners of small triangles."""
        shape, which = faces.shape, faces.corners_of(SMALL)
        light = np.empty((len(which), 3), np.float32)
        apply_shadow(
            self.lighting.shade(shape, which, faces.outwards, is_stage),
            shadow.visibility(shadow.coordinates(shape, which, faces.outwards)),
            light,
        )
        colours = np.empty((len(shape.vertices), 3), np.float32)
        colours[which] = _values(light, self.setup, self.display)
        return colours

    def _large_triangles(self, faces: VisibleFaces, shadow: ShadowMap, is_stage: bool) -> LargeTriangles:
        """Return the inputs of large triangles."""
        shape, which = faces.shape, faces.corners_of(LARGE)
        values = np.empty((len(shape.vertices) if len(which) else 0, 12), np.float32)
        light = self.lighting.shade(shape, which, faces.outwards, is_stage).reshape(-1, 2, 3)
        light = np.concatenate([light, light.mean(axis=1, keepdims=True)], axis=1)
        shown = _values(light.reshape(-1, 3), self.setup, self.display).reshape(-1, 3, 3)
        values[which, :6], values[which, 9] = shown[:, :2].reshape(-1, 6), bulges(shown)
        values[which, 6:9] = shadow.coordinates(shape, which, faces.outwards).T
        contact = self.lighting.contact
        values[which, 10:] = contact.coordinates(shape.vertices[which]) if is_stage else -1.0
        pixels = self.nearness.size // SUPERSAMPLING**2
        hits, values_at_hits = np.empty((4, pixels), np.int32), np.empty((15, pixels), np.float32)
        return LargeTriangles(
            shape.vertices,
            *self.projection,
            values,
            shadow.nearness,
            shadow.blocks,
            contact.factors(LOOKS_DARK if self.display else PACKED_DARK),
            _ambient(self.setup.lights, self.setup.stage, self.setup.view, self.display),
            shadow.opacity,
            hits,
            values_at_hits,
        )

    def picture(self) -> NDArray[np.float32]:
        """Return the picture (H, W, 3)."""
        rows, columns = self.nearness.shape
        picture = np.empty((rows // SUPERSAMPLING, columns // SUPERSAMPLING, 3), np.float32)
        average(self.colour, picture)
        return picture


@lru_cache(maxsize=16)
def _ambient(rig: LightRig, stage: Stage, view: ColourView, display: str) -> float:
    """Return the fraction of a value in the middle of the floor that all light but the key light makes."""
    lit, dark = floor_light(rig, stage)
    setup = StageSetup(rig, stage, StagePlacement(), view)
    whole, key = _values(np.stack([lit, lit - dark]), setup, display).mean(axis=1).tolist()
    return 1.0 - float(key) / max(float(whole), 1e-6)


def bulges(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return how far values (N,) fall in a penumbra from a straight line between light and shadow.

    values  (N, 3, 3): in the key light, in its shadow, and half way between, in any display

    In the fraction v of the key light, a value is v + bulge v (1 - v) of the way to that in the light.
    """
    lit, dark, half = values.mean(axis=2).T
    way = np.maximum(lit - dark, 1e-3)
    return np.clip(4.0 * (half - dark) / way - 2.0, 0.0, 1.0)


def _values(light: NDArray[np.float32], setup: StageSetup, display: str) -> NDArray[np.float32]:
    """Return the values (N, 3) of linear light (N, 3): display values, or packed light without a display."""
    if display:
        return displayed(light, setup, display)
    packed = np.empty_like(light)
    pack_light(light, packed)
    return packed


def displayed(light: NDArray[np.float32], setup: StageSetup, display: str) -> NDArray[np.float32]:
    """Return display values (N, 3) of linear light (N, 3)."""
    return to_display(light[None], setup.lights.exposure, display, setup.view).reshape(light.shape)
