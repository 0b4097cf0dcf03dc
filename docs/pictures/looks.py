"""The contact sheet of docs/shot-files.md: one sculpture in every look. `make pictures`, or this file.

With names only these are rendered, to pictures of their own beside the one that `-o` names.
"""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

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
from flowsculpt.render.scene.scene_lights import LIGHTS
from flowsculpt.render.scene.surface import Surface, outlines

HERE = Path(__file__).parent
QUALITY = dataclasses.replace(QUALITIES["final"], width=480, height=405)
COLUMNS, CAPTION, FONT = 4, 48, "DroidSans"
SHOT = """
title: A bar wrung
frames: 1-12
subject: {solid: box, size: [1.4, 2.5, 1.4]}
resample: {max_edge_length: 0.2}
flows:
  - twist: {axis: y, amount: {ease: linear, keys: {1: 0, 12: 82}}}
  - bend: {axis: y, direction: x, length: 3, amount: {ease: linear, keys: {1: 0, 12: 34}}}
look: %s
smooth: {tessellate: 4}
"""
SHEET = {
    "clay": "clay",
    "putty": "putty",
    "glaze": "glaze",
    "ceramic": "ceramic",
    "chrome": "chrome",
    "brushed": "brushed",
    "pearl": "pearl",
    "marble": "marble",
    "swirl": "swirl",
    "honey": "honey",
    "glass": "glass",
    "frosted": "frosted",
    "smoke": "{material: smoke, density: 10}",
    "taffy": "taffy",
    "cream": "cream",
    "symbolics_1990": "symbolics_1990",
    "speed": "speed",
    "strain": "{material: strain, measure: {stretch: {range: [1, 2.5]}}}",
    "clay, measure: area": "{material: clay, measure: {area: {range: [0.5, 2]}}}",
    "bsdf: gold": "{bsdf: {type: roughconductor, material: Au, alpha: 0.12}}",
    "marble, subsurface": "{material: marble, subsurface: {radius: 0.1}}",
    "cream, subsurface": "{material: cream, subsurface: {radius: [0.1, 0.07, 0.04]}}",
    "honey, subsurface": "{material: honey, subsurface: {radius: 1}}",
    "clay, wireframe": "{material: clay, colour: [0.7, 0.7, 0.7], wireframe: {width: 0.6}}",
}
"""What stands under each picture, and what the shot file says."""

MIRRORS = ("chrome", "brushed", "bsdf: gold")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("looks", nargs="*", metavar="LOOK")
    parser.add_argument("-o", "--output", type=Path, default=HERE / "looks.webp")
    asked = parser.parse_args()
    shots = {name: _shot(SHEET[name]) for name in asked.looks or SHEET}
    surface, framing = _sculpture(next(iter(shots.values())))
    pictures = {name: _picture(name, shot, surface, framing) for name, shot in shots.items()}
    if asked.looks:
        for name, picture in pictures.items():
            picture.save(asked.output.with_name(f"{name}.png"))
    else:
        _sheet(pictures).save(asked.output, quality=84, method=6)


def _shot(look: str) -> Shot:
    return read_shot("looks.yaml", SHOT % look)


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


def _picture(name: str, shot: Shot, surface: Surface, framing: Framing) -> Image.Image:
    rig = LIGHTS["gallery" if name in MIRRORS else "studio"]
    scene = Scene(surface, shot.picture.look, rig, shot.picture.stage, framing.placement, framing.camera)
    layers = render_frame(scene, QUALITY, seed=1, engine=choose())
    return Image.fromarray(quantise(to_display(denoise(layers), display="srgb")))


def _sheet(pictures: dict[str, Image.Image]) -> Image.Image:
    """All of them, their names below."""
    width, height = QUALITY.width, QUALITY.height
    rows = -(-len(pictures) // COLUMNS)
    sheet = np.full((rows * (height + CAPTION), COLUMNS * width, 3), 250, dtype=np.uint8)
    for index, (name, picture) in enumerate(pictures.items()):
        row, column = divmod(index, COLUMNS)
        y, x = row * (height + CAPTION), column * width
        sheet[y : y + height, x : x + width] = np.asarray(picture)
        words = lettering(name, FONT, 20)
        across = x + (width - words.shape[1]) // 2
        below = y + height + (CAPTION - words.shape[0]) // 2
        part = sheet[below : below + words.shape[0], across : across + words.shape[1]]
        part -= (215 * words[..., None]).astype(np.uint8)
    return Image.fromarray(sheet)


if __name__ == "__main__":
    main()
