"""The sheet of rigs and stages in docs/rendering.md, of a frame that `make film` has made: `make pictures`.

`--root` says where that is.
"""

from __future__ import annotations

import argparse
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from pipeline.production.request.framing import Framing, with_stage_in_view
from render.base.serialise import from_plain
from render.frame.batch_schedule import seed_of
from render.frame.render_frame import render_frame
from render.mitsuba.engine import choose
from render.post.colour import quantise, to_display
from render.post.denoise import denoise
from render.scene.materials import LOOKS
from render.scene.render_quality import QUALITIES
from render.scene.scene import Scene
from render.scene.scene_lights import LIGHTS, LightRig
from render.scene.scene_stage import STAGES, Stage
from render.scene.sky import Daylight
from render.scene.surface import Surface

OUT = Path(__file__).parent / "sets.webp"
SHOT, FRAME = "A010_cube", 44
COLUMNS = 2
_EVENING = LightRig(daylight=Daylight(math.radians(14.0), math.radians(-95.0)))

SHEET: tuple[tuple[LightRig, Stage, str], ...] = (
    (LIGHTS["studio"], STAGES["cyclorama"], "clay"),
    (LIGHTS["three_point"], STAGES["cyclorama"], "clay"),
    (LIGHTS["softbox"], STAGES["cyclorama"], "clay"),
    (LIGHTS["daylight"], STAGES["cyclorama"], "clay"),
    (LIGHTS["three_point"], STAGES["plinth"], "glaze"),
    (LIGHTS["studio"], STAGES["turntable"], "clay"),
    (_EVENING, STAGES["ground"], "taffy"),
    (LIGHTS["gallery"], replace(STAGES["cyclorama"], roughness=0.12, colour=(0.06, 0.06, 0.065)), "chrome"),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--root", type=Path, default=Path())
    folder = parser.parse_args().root / "renders" / SHOT
    arrays = np.load(folder / "normals" / f"{SHOT}.{FRAME:04d}.npz")
    surface = Surface(arrays["vertices"], arrays["normals"], arrays["faces"])
    framing = from_plain(Framing, json.loads((folder / f"{SHOT}.cameras.json").read_text())[str(FRAME)])
    pictures = [_picture(surface, framing, *each) for each in SHEET]
    width, height = pictures[0].size
    sheet = Image.new("RGB", (COLUMNS * width, -(-len(pictures) // COLUMNS) * height))
    for i, picture in enumerate(pictures):
        sheet.paste(picture, (i % COLUMNS * width, i // COLUMNS * height))
    sheet.save(OUT, quality=86, method=6)


def _picture(surface: Surface, framing: Framing, lights: LightRig, stage: Stage, look: str) -> Image.Image:
    quality = QUALITIES["draft"]
    there = with_stage_in_view(framing, stage, quality.aspect)
    seed = seed_of("sets", stage.kind)
    scene = Scene(surface, LOOKS[look], lights, stage, there.placement, there.camera)
    layers = render_frame(scene, quality, seed, choose())
    return Image.fromarray(quantise(to_display(denoise(layers), lights.exposure, "srgb")))


if __name__ == "__main__":
    main()
