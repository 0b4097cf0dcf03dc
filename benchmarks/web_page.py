"""`python -m benchmarks.web_page [SHOT]`: frames a second of an exported page, and what soft shadows cost.

Every twelfth frame of a shot (A010_cube) is drawn by its page, 480 × 270 pixels, until its pixels are read:
as exported, with the shadows of three.js (percentage-closer filtering, 3 × 3 pixels), and without shadows.
Chromium is the one of the tests (`python tests/chromium.py fetch`); it draws on the processor.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from playwright.sync_api import Browser

from benchmarks.first_film import CHECKOUT
from benchmarks.measured_shots import copy_shots
from benchmarks.report import Row, keep, show
from tests.chromium import running, wait_for

SIZE = {"width": 480, "height": 270}
STEP = 12
SOFT, OWN = "before + SOFT_SHADOW + after", "chunks.shadowmap_pars_fragment"
"""What the page's script puts in the place of the shadows of three.js, and these."""

WITHOUT_SHADOWS = """() => flowsculpt.player.scene.traverse((object) => {
  if (object.isLight) object.castShadow = false;
  for (const each of [object.material].flat()) if (each) each.needsUpdate = true;
})"""
DRAW = """(step) => {
  const { player, transport } = flowsculpt, gl = player.renderer.getContext(), took = [];
  transport.playing = false;
  const draw = (number) => {
    player.show(number);
    player.draw();
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
  };
  draw(transport.first); // compiles the shaders
  for (let number = transport.first; number <= transport.last; number += step) {
    const start = performance.now();
    draw(number);
    took.push(performance.now() - start);
  }
  return took;
}"""


def main(shot: str = "A010_cube") -> None:
    """Measure the page of a shot, and write `benchmarks/out/web_page.json`."""
    with tempfile.TemporaryDirectory() as folder, running() as browser:
        root = Path(folder)
        copy_shots(root)
        words = ["--no-progress", "--root", folder, "export", "web", root / "shots" / f"{shot}.yaml"]
        subprocess.run([CHECKOUT / ".venv/bin/flowsculpt", *words], check=True, cwd=CHECKOUT)
        exported = next(root.glob(f"renders/{shot}/web/*.html"))
        text = exported.read_text()
        if text.count(SOFT) != 1:
            raise RuntimeError(f"{exported.name}: {SOFT!r} is not in the page; mend this benchmark")
        filtered = exported.with_name("filtered.html")
        filtered.write_text(text.replace(SOFT, OWN))
        rows = [
            {"shadows": name, **measure(browser, page, name == "none")}
            for name, page in (("soft", exported), ("of three.js", filtered), ("none", exported))
        ]
    show(f"page of {shot}", rows)
    keep("web_page", rows)


def measure(browser: Browser, page: Path, bare: bool) -> Row:
    """Return the median time of drawing a frame, without shadows if `bare`."""
    tab = browser.new_page(viewport=SIZE, reduced_motion="reduce")
    tab.goto(f"{page.as_uri()}#bare")
    wait_for(tab, "window.flowsculpt", 60)
    if bare:
        tab.evaluate(WITHOUT_SHADOWS)
    took = float(np.median(tab.evaluate(DRAW, STEP)))
    tab.close()
    return {"ms": took, "frames a second": 1000.0 / took}


if __name__ == "__main__":
    main(*sys.argv[1:])
