"""`python -m benchmarks.layers FRAME`: size and CPU seconds of a finished EXR, with layers and without.

FRAME is a finished frame with layers, as `flowsculpt render A010_cube -f 40 --scale 400% --layers nuke` makes
one of 1920 × 1080 pixels.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

from flowsculpt.render.post.image import read_exr, write_exr
from flowsculpt.render.scene.aovs import RenderedFrame


def main(frame: Path) -> None:
    layers, header = read_exr(frame)
    groups = {
        "RGB": ["beauty"],
        "RGBA": ["beauty", "alpha"],
        "all layers": list(layers.arrays),
    }
    with tempfile.TemporaryDirectory() as folder:
        for name, chosen in groups.items():
            path, begun = Path(folder) / "frame.exr", time.process_time()
            write_exr(
                path, RenderedFrame({layer: layers[layer] for layer in chosen}), header, convention="nuke"
            )
            seconds = time.process_time() - begun
            print(f"{name}: {path.stat().st_size / 1e6:.1f} MB, {seconds:.2f} CPU s")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
