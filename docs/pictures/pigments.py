"""The sheet of patterns in docs/shot-files.md, at rest and after a flow: `make pictures`."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

OUT = Path(__file__).parent
FRAMES = 1, 60
WIDTH = 400

SHOT = """
title: Pigments
frames: 1-60
subject: {solid: rod, length: 2.6, radius: 0.75, caps: round}
resample: {max_edge_length: 0.07}
flows:
  - twist: {axis: y, amount: {keys: {2: 0, 56: 110}}}
  - sum:
      - vortex:
          axis: z
          centre: [0.5, 0.5, 0]
          radius: 0.55
          strength: {keys: {2: 0, 20: 1.3, 50: 1.3, 58: 0}}
look:
  material: ceramic
  roughness: 0.08
  pigment: PIGMENT
smooth: {dicing: 2px}
camera: {azimuth: -24, elevation: 10, focal_length: 85}
lights: {rig: porcelain, exposure: -0.2}
stage: {kind: cyclorama, colour: [0.02, 0.03, 0.045]}
"""

PIGMENTS = {
    "chips": """
    chips:
      colours: ["#d9d2c3", "#1d2a38", "#8c3b2a", "#c08a3e", "#3f5f52"]
      scale: 0.4
      sizes: 3
      roughness: [0.4, 0.05, 0.05, 0.05, 0.05]""",
    "spots": """
    spots: {colours: ["#20242c", "#d8c9a6", "#b8432f", "#e8e4da"], scale: 0.26, share: 0.75}""",
    "radial": """
    radial:
      colours: ["#f0ebe0", "#1f4e79", "#f0ebe0", "#c9a227"]
      scale: 0.13
      centre: [-0.2, 0.3, 0.7]
      turbulence: 0.4
      seed: 2""",
    "relief": """
    layers: {colours: ["#eef0ea", "#7fa5a0"], axis: x, scale: 0.09, softness: 1, heights: [0.02, 0]}""",
}


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        shots = Path(folder) / "shots"
        shots.mkdir()
        for name, pigment in PIGMENTS.items():
            (shots / f"{name}.yaml").write_text(SHOT.replace("PIGMENT", pigment))
        command = [str(Path(sys.executable).with_name("flowsculpt")), "--no-progress", "stills", *PIGMENTS]
        subprocess.run([*command, "-f", "1,60", "-q", "draft"], cwd=folder, check=True)
        stills = [
            [
                Image.open(Path(folder) / f"renders/{name}/draft/png/{name}.{frame:04d}.png")
                for name in PIGMENTS
            ]
            for frame in FRAMES
        ]
        sheet = Image.new("RGB", (WIDTH * len(PIGMENTS), 2 * WIDTH))
        for row, pictures in enumerate(stills):
            for column, picture in enumerate(pictures):
                side = min(picture.size)
                left = (picture.width - side) // 2
                square = picture.crop((left, 0, left + side, side)).resize((WIDTH, WIDTH), Image.LANCZOS)
                sheet.paste(square, (column * WIDTH, row * WIDTH))
    sheet.save(OUT / "patterns.webp", quality=84, method=6)


if __name__ == "__main__":
    main()
