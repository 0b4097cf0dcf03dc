"""The pixels of a quick preview, of any camera, with edges of faces and lines over it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.post.colour import quantise
from flowsculpt.render.post.view import ColourView
from flowsculpt.render.raster.preview import Edges, preview, wide_picture, with_lines
from flowsculpt.render.raster.raster_shapes import Floats, Shape, StageSetup
from flowsculpt.render.scene.render_camera import Camera, WideCamera
from flowsculpt.render.scene.scene import stage_fades
from flowsculpt.render.scene.scene_lights import LightRig
from flowsculpt.render.scene.scene_stage import Stage, StagePlacement

Lines = tuple[Floats, Floats, Floats]
"""Polylines: points (N, K, 3), display colours (N, K, 3) and opacities (N, K)."""


class StagedPicture(Protocol):
    """What a picture of a shot says of all that is around its subjects."""

    @property
    def lights(self) -> LightRig: ...

    @property
    def stage(self) -> Stage: ...

    @property
    def view(self) -> ColourView: ...


class FramedStage(Protocol):
    """Where camera and stage of a picture are."""

    @property
    def camera(self) -> Camera: ...

    @property
    def placement(self) -> StagePlacement: ...


def draw_preview(
    shapes: Sequence[Shape],
    picture: StagedPicture,
    framing: FramedStage,
    size: tuple[int, int],
    display: str = "srgb",
    *,
    has_edges: bool = False,
    lines: Lines | None = None,
    line_width: float = 0.0,
    is_rough: bool = False,
) -> NDArray[Any]:
    """Draw subjects on their stage quickly, without a path tracer; return the picture uint8 (H, W, 3).

    picture     of the shot: its lights, stage and view
    framing     the camera, and the placement of the stage
    size        width and height in pixels
    display     rec709 for movies, srgb for pages
    has_edges   draw the edges of faces
    lines       points (N, K, 3), display colours (N, K, 3) and opacities (N, K) of lines in the scene
    line_width  their width, over that of the picture; at least one pixel
    is_rough    draw at half the size and let outlines show steps: as sharp in about half the time. Where
                light passes through a subject, or the camera is wide, the picture has half the size
    """
    lights, view, whole = picture.lights, picture.view.for_previews(), framing.camera
    fades = stage_fades(whole, lights)
    setup = StageSetup(lights, picture.stage, framing.placement, view, fades)
    first, *others = shapes
    is_rough = is_rough and not has_edges and lines is None
    size = (size[0] // 2, size[1] // 2) if is_rough else size

    def draw(camera: Camera, size: tuple[int, int]) -> NDArray[np.float32]:
        edges = Edges() if has_edges else None
        drawn = preview(first, setup, camera, size, display, edges, others, is_rough and camera is whole)
        if lines is None:
            return drawn.picture
        return with_lines(drawn, *lines, camera, max(1.0, line_width * size[0]))

    return quantise(wide_picture(whole, size, draw) if isinstance(whole, WideCamera) else draw(whole, size))
