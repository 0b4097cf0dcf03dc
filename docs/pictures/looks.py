"""The contact sheet of docs/shot-files.md: one sculpture in every look. `make pictures`, or this file.

With names only these are rendered, to pictures of their own beside the one that `-o` names.
"""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from flowsculpt.pipeline.animation import animate, material_of
from flowsculpt.pipeline.mesh.normals import split_at_creases, spread, tessellate
from flowsculpt.pipeline.production.request.framing import BoundingSpheres, Framer, Framing
from flowsculpt.pipeline.production.request.shading import Shading
from flowsculpt.pipeline.shot import read_shot
from flowsculpt.pipeline.shot.camera_path import View
from flowsculpt.pipeline.shot.shot import Shot
from flowsculpt.render.frame.render_frame import render_frame
from flowsculpt.render.graphics.typesetting import lettering
from flowsculpt.render.mitsuba.engine import choose
from flowsculpt.render.post.colour import quantise, to_display
from flowsculpt.render.post.denoise import denoise
from flowsculpt.render.scene.render_quality import QUALITIES
from flowsculpt.render.scene.scene import Scene
from flowsculpt.render.scene.surface import Surface, outlines

HERE = Path(__file__).parent
QUALITY = dataclasses.replace(
    QUALITIES["daily"], width=256, height=216, samples=16, temporal_denoise=0, noise_threshold=None
)
COLUMNS, CAPTION, FONT = 5, 30, "DroidSans"

Picture = NDArray[np.uint8]
SHOT = """
title: A bar wrung
frames: 1-12
subject: {solid: box, size: [1.4, 2.5, 1.4]}
resample: {max_edge_length: 0.13}
flows:
  - twist: {axis: y, amount: {ease: linear, keys: {1: 0, 12: 82}}}
  - bend: {axis: y, direction: x, length: 3, amount: {ease: linear, keys: {1: 0, 12: 34}}}
look: %s
%s
smooth: {tessellate: 2}
"""
SOFT = "lights: studio\nstage: {kind: cyclorama, colour: [0.2, 0.2, 0.21]}"
PALE = "lights: porcelain\nstage: {kind: cyclorama, colour: [0.02, 0.045, 0.1]}"
WARM = "lights: porcelain\nstage: {kind: cyclorama, colour: [0.07, 0.03, 0.022]}"
MIRRORED = "lights: duotone\nstage: {kind: cyclorama, colour: [0.02, 0.02, 0.025]}"
STRIPS = "lights: gallery\nstage: {kind: cyclorama, colour: [0.05, 0.05, 0.055]}"
RED = "lights: {rig: lacquer, exposure: 0.4}\nstage: {kind: cyclorama, colour: [0.36, 0.02, 0.012]}"
DARK = "lights: {rig: lacquer, exposure: 0.6}\nstage: {kind: cyclorama, colour: [0.03, 0.035, 0.045]}"
BRIGHT = "lights: {rig: bright_field, exposure: -0.3}\nstage: {kind: ground, colour: [0.3, 0.28, 0.25]}"
SMOKY = (
    "lights: {softboxes: [{position: [-4.5, 3.5, -2.5], width: 1.2, height: 3, radiance: [60, 56, 50]}, "
    "{position: [4.5, 2.5, -2], width: 0.8, height: 3, radiance: [14, 24, 44]}], sky: {zenith: 0.02}}\n"
    "stage: {kind: cyclorama, colour: [0.012, 0.013, 0.016]}"
)
EVEN = "lights: {rig: softbox, exposure: -0.3}\nstage: {kind: cyclorama, colour: [0.1, 0.1, 0.105]}"
SHEET = {
    "clay": ("clay", SOFT),
    "putty": ("putty", SOFT),
    "glaze": ("glaze", DARK),
    "ceramic": ("ceramic", PALE),
    "chrome": ("chrome", MIRRORED),
    "brushed": ("brushed", STRIPS),
    "bsdf: gold": ("{bsdf: {type: roughconductor, material: Au, alpha: 0.12}}", STRIPS),
    "pearl": ("pearl", PALE),
    "marble": ("marble", WARM),
    "swirl": ("swirl", PALE),
    "taffy": ("taffy", SOFT),
    "cream": ("cream", WARM),
    "coffee": ("coffee", RED),
    "honey": ("honey", BRIGHT),
    "glass": ("glass", BRIGHT),
    "frosted": ("frosted", BRIGHT),
    "smoke": ("{material: smoke, density: 5}", SMOKY),
    "speed": ("speed", EVEN),
    "strain": ("{material: strain, measure: {stretch: {range: [1, 2.5]}}}", EVEN),
    "clay, measure: area": ("{material: clay, measure: {area: {range: [0.5, 2]}}}", EVEN),
    "cream, subsurface": ("{material: cream, subsurface: {radius: [0.1, 0.07, 0.04]}}", WARM),
    "glaze, wear: dust": ("{material: glaze, wear: {dust: 0.6}}", DARK),
    "putty, wear: weave": ("{material: putty, wear: {weave: 0.8}}", SOFT),
    "clay, wireframe": ("{material: clay, colour: [0.7, 0.7, 0.7], wireframe: {width: 0.6}}", SOFT),
    "symbolics_1990": ("symbolics_1990", SOFT),
}
"""What stands under each picture, the look that the shot file writes, and the light that flatters it."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("looks", nargs="*", metavar="LOOK")
    parser.add_argument("-o", "--output", type=Path, default=HERE / "looks.webp")
    asked = parser.parse_args()
    shots = {name: read_shot("looks.yaml", SHOT % SHEET[name]) for name in asked.looks or SHEET}
    surface, framing = _sculpture(next(iter(shots.values())))
    pictures = {name: _picture(name, shot, surface, framing) for name, shot in shots.items()}
    if asked.looks:
        for name, picture in pictures.items():
            _write(asked.output.with_name(f"{name}.png"), picture)
    else:
        _write(asked.output, _sheet(pictures))


def _write(path: Path, picture: Picture) -> None:
    buffer = oiio.ImageBuf(picture)
    buffer.specmod().attribute("Compression", "webp:84")
    buffer.write(str(path))


def _sculpture(shot: Shot) -> tuple[Surface, Framing]:
    """The last frame, as `flowsculpt` would show it."""
    *_, frame = animate(shot)
    split = split_at_creases(frame.mesh, np.radians(40.0))
    fine = tessellate(split, shot.picture.tessellate)
    rest = spread(material_of(frame.mesh), split, fine)
    (framing,) = Framer(
        [View(np.radians(-28.0), np.radians(14.0), np.radians(26.0), 0.09)],
        lambda _: BoundingSpheres(fine.vertices, np.zeros(len(fine.vertices))),
        QUALITY.aspect,
    ).all()
    arrays: dict[str, Any] = {
        name: array.astype(np.float32)
        for name, array in (("vertices", fine.vertices), ("normals", fine.normals), ("rest", rest))
    }
    edges = outlines(fine.faces, shot.picture.tessellate)
    shading = Shading(frame, split, shot.picture.tessellate)
    brought = {Surface.SPEED: shading.speeds(shot.motion)}
    return Surface(faces=fine.faces, edges=edges, attributes=brought, **arrays), framing


def _picture(name: str, shot: Shot, surface: Surface, framing: Framing) -> Picture:
    shown = shot.picture
    scene = Scene(surface, shown.look, shown.lights, shown.stage, framing.placement, framing.camera)
    layers = render_frame(scene, QUALITY, seed=1, engine=choose())
    print(name, flush=True)
    return quantise(to_display(denoise(layers), shown.lights.exposure, display="srgb"))


def _sheet(pictures: dict[str, Picture]) -> Picture:
    """Return all of them, their names below."""
    width, height = QUALITY.width, QUALITY.height
    rows = -(-len(pictures) // COLUMNS)
    sheet = np.full((rows * (height + CAPTION), COLUMNS * width, 3), 250, dtype=np.uint8)
    for index, (name, picture) in enumerate(pictures.items()):
        row, column = divmod(index, COLUMNS)
        y, x = row * (height + CAPTION), column * width
        sheet[y : y + height, x : x + width] = picture
        words = lettering(name, FONT, 14)
        across = x + (width - words.shape[1]) // 2
        below = y + height + (CAPTION - words.shape[0]) // 2
        part = sheet[below : below + words.shape[0], across : across + words.shape[1]]
        part -= (215 * words[..., None]).astype(np.uint8)
    return sheet


if __name__ == "__main__":
    main()
