"""The sheets of rigs, stages and sets in the docs: `make pictures`, or this file with names of sheets.

`rigs` and `dark_sets`, in docs/rendering.md, show a frame that `make film` has made; `--root` says where that
is. `sets`, in docs/shot-files.md, is a wedge of the same frame over all sets.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml
from PIL import Image

from flowsculpt.pipeline.production.request.framing import Framing
from flowsculpt.render.base.serialise import from_plain
from flowsculpt.render.frame.batch_schedule import seed_of
from flowsculpt.render.frame.render_frame import render_frame
from flowsculpt.render.mitsuba.engine import choose
from flowsculpt.render.post.colour import quantise, to_display
from flowsculpt.render.post.denoise import denoise
from flowsculpt.render.scene.materials import LOOKS, Material
from flowsculpt.render.scene.render_quality import QUALITIES
from flowsculpt.render.scene.scene import Scene
from flowsculpt.render.scene.scene_lights import LIGHTS, LightRig
from flowsculpt.render.scene.scene_sets import SETS
from flowsculpt.render.scene.scene_stage import STAGES, Stage
from flowsculpt.render.scene.sky import Daylight
from flowsculpt.render.scene.surface import Surface

OUT = Path(__file__).parent
SHOT, FRAME = "A010_cube", 44
COLUMNS = 2
_EVENING = LightRig(daylight=Daylight(math.radians(14.0), math.radians(-95.0)))
_MIRRORING = replace(STAGES["cyclorama"], roughness=0.12, colour=(0.06, 0.06, 0.065))

RIGS: tuple[tuple[LightRig, Stage, Material], ...] = (
    (LIGHTS["studio"], STAGES["cyclorama"], LOOKS["clay"]),
    (LIGHTS["three_point"], STAGES["cyclorama"], LOOKS["clay"]),
    (LIGHTS["softbox"], STAGES["cyclorama"], LOOKS["clay"]),
    (LIGHTS["daylight"], STAGES["cyclorama"], LOOKS["clay"]),
    (LIGHTS["three_point"], STAGES["plinth"], LOOKS["glaze"]),
    (LIGHTS["studio"], STAGES["turntable"], LOOKS["clay"]),
    (_EVENING, STAGES["ground"], LOOKS["taffy"]),
    (LIGHTS["gallery"], _MIRRORING, LOOKS["chrome"]),
)

_LACQUER = LOOKS["ceramic"].with_values(colour=(0.006, 0.006, 0.008), roughness=0.06)
_NIGHT = replace(STAGES["cyclorama"], colour=(0.012, 0.012, 0.016), roughness=0.15)
_WET = replace(STAGES["ground"], colour=(0.02, 0.012, 0.01), roughness=0.08)
DARK_SETS: tuple[tuple[LightRig, Stage, Material], ...] = (
    (LIGHTS["porcelain"], replace(STAGES["cyclorama"], colour=(0.02, 0.03, 0.045)), LOOKS["ceramic"]),
    (LIGHTS["duotone"], _NIGHT, LOOKS["chrome"]),
    (LIGHTS["lacquer"], replace(STAGES["cyclorama"], colour=(0.55, 0.03, 0.012)), _LACQUER),
    (LIGHTS["macro"], replace(STAGES["cyclorama"], colour=(0.02, 0.02, 0.02)), LOOKS["cream"]),
    (LIGHTS["bright_field"], _WET, LOOKS["glass"]),
    (LIGHTS["monument"], replace(STAGES["ground"], colour=(0.42, 0.36, 0.3)), LOOKS["taffy"]),
)
"""The rigs with few and strong lights, each with a set and a look that suit it."""


SHEETS = {"rigs": RIGS, "dark_sets": DARK_SETS}
PLACE = ("look", "camera", "lights", "stage")
"""What the frame's shot says itself, and its copy in a set does not."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sheets", nargs="*", metavar="SHEET", default=[*SHEETS, "sets"])
    parser.add_argument("--root", type=Path, default=Path())
    asked = parser.parse_args()
    if unknown := sorted({*asked.sheets} - {*SHEETS, "sets"}):
        sys.exit(f"{', '.join(unknown)}: no such sheet; there are {', '.join(SHEETS)}, sets")
    for name in asked.sheets:
        sheet = _all_sets() if name == "sets" else _sheet(asked.root / "renders" / SHOT, SHEETS[name])
        sheet.save(OUT / f"{name}.webp", quality=86, method=6)


def _all_sets() -> Image.Image:
    """Return the contact sheet of a wedge: the frame's shot in clay, in each set."""
    shot = yaml.safe_load(Path("shots", f"{SHOT}.yaml").read_text(encoding="utf-8"))
    plain = {name: value for name, value in shot.items() if name not in PLACE}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "S010_place.yaml")
        path.write_text(yaml.safe_dump({**plain, "title": "Sets"}, sort_keys=False), encoding="utf-8")
        words = ["--no-progress", "--json", "--root", folder, "wedge", str(path)]
        words += ["--vary", f"set={','.join(SETS)}", "--at", str(FRAME), "--columns", "5"]
        command = [sys.executable, "-m", "flowsculpt", *words]
        answer = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
        with Image.open(Path(folder, json.loads(answer)["sheets"][0])) as sheet:
            return sheet.convert("RGB")


def _sheet(folder: Path, shown: tuple[tuple[LightRig, Stage, Material], ...]) -> Image.Image:
    """Return the frame in one light, stage and look after another."""
    arrays = np.load(folder / "normals" / f"{SHOT}.{FRAME:04d}.npz")
    surface = Surface(arrays["vertices"], arrays["normals"], arrays["faces"])
    framing = from_plain(Framing, json.loads((folder / f"{SHOT}.cameras.json").read_text())[str(FRAME)])
    pictures = [_picture(surface, framing, *each) for each in shown]
    width, height = pictures[0].size
    sheet = Image.new("RGB", (COLUMNS * width, -(-len(pictures) // COLUMNS) * height))
    for i, picture in enumerate(pictures):
        sheet.paste(picture, (i % COLUMNS * width, i // COLUMNS * height))
    return sheet


def _picture(
    surface: Surface, framing: Framing, lights: LightRig, stage: Stage, look: Material
) -> Image.Image:
    quality = QUALITIES["draft"]
    there = framing.with_stage_in_view(stage, quality.aspect)
    seed = seed_of("sets", stage.kind)
    scene = Scene(surface, look, lights, stage, there.placement, there.camera)
    layers = render_frame(scene, quality, seed, choose())
    return Image.fromarray(quantise(to_display(denoise(layers), lights.exposure, "srgb")))


if __name__ == "__main__":
    main()
