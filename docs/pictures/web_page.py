"""The picture of exported pages in docs/interchange.md: frames by the path tracer and on the page.

`--root` says where to render.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

from flowsculpt.render.post.colour import quantise, to_display
from flowsculpt.render.post.image import read_exr
from tests.chromium import fetch, running, wait_for

PICTURE = Path(__file__).with_suffix(".webp")
SHOT, FRAMES = "A010_cube", (6, 28, 44)
SIZE = (480, 270)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--root", type=Path, default=Path())
    root = parser.parse_args().root

    def run(*words: str) -> str:
        command = [sys.executable, "-m", "flowsculpt", "--json", "--root", str(root), *words]
        return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout

    run("render", SHOT, "-f", ",".join(map(str, FRAMES)))
    page = Path(json.loads(run("export", "web", SHOT))["path"])
    together = Image.new("RGB", (2 * SIZE[0], len(FRAMES) * SIZE[1]))
    fetch()
    with running() as browser, tempfile.TemporaryDirectory() as folder:
        tab = browser.new_page(
            viewport={"width": SIZE[0], "height": SIZE[1]}, device_scale_factor=2, reduced_motion="reduce"
        )
        tab.goto(f"{page.absolute().as_uri()}#bare")
        wait_for(tab, "window.flowsculpt")
        for row, number in enumerate(FRAMES):
            frame = root / "renders" / SHOT / "draft" / "frames" / f"{SHOT}.{number:04d}.exr"
            traced = quantise(to_display(read_exr(frame)[0]["beauty"], display="srgb"))
            together.paste(Image.fromarray(traced), (0, row * SIZE[1]))
            tab.evaluate("(number) => flowsculpt.transport.go(number)", number)
            tab.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
            tab.screenshot(path=f"{folder}/page.png")
            with Image.open(f"{folder}/page.png") as shown:
                together.paste(shown.convert("RGB").resize(SIZE), (SIZE[0], row * SIZE[1]))
    together.save(PICTURE, quality=86, method=6)


if __name__ == "__main__":
    main()
