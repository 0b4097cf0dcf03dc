"""The speed of a review page, to write, open, step and play it: `python -m benchmarks.review`.

`python -m benchmarks.review final` takes minutes to write its pictures. Chromium is the one of the tests:
`python tests/chromium.py fetch` unpacks it. It draws on the processor; graphics cards are
faster.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import Page as Tab

from benchmarks.report import Row, Target, keep, show
from tests.chromium import running
from tests.plugins.review.studio import Picture, hang
from tests.simulated_show import NAME, SHOT, Desk, simulated

FRAMES = 240
QUALITIES = {"draft": (480, 270), "daily": (960, 540), "final": (1920, 1080)}
PLAYED = 4.0
"""Seconds of playback."""

STEPS = 40


def painted(number: int, size: tuple[int, int]) -> Picture:
    """Return a picture like a render: shading, an edge that moves, and the noise that a denoiser leaves."""
    width, height = size
    y, x = np.mgrid[:height, :width] / np.float32(height)
    ball = np.hypot(x - 0.9 - 0.3 * np.sin(number / 20.0), y - 0.5) < 0.3
    light = np.where(ball, 0.6 - 0.5 * y, 0.25 + 0.2 * y)
    noise = np.random.default_rng(number).normal(0.0, 0.004, (height, width, 3))
    return np.asarray(light[..., None] * (0.9, 0.8, 0.7) + noise, np.float32)


def measured(desk: Desk, quality: str) -> Row:
    request = desk.request(quality)
    hang(desk, request, request.angles, lambda number: painted(number, QUALITIES[quality]))
    start = time.perf_counter()
    code, words = desk.command("review", NAME, "-q", quality, "--name", quality)
    assert code == 0, words
    first = time.perf_counter() - start
    start = time.perf_counter()
    desk.command("review", NAME, "-q", quality, "--name", quality)
    again = time.perf_counter() - start
    folder = desk.page(quality).parent
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    return {
        "quality": quality,
        "write s": first,
        "again s": again,
        "MB": size / 1e6,
        **_in_browser(desk.page(quality)),
    }


def _in_browser(page: Path) -> dict[str, float]:
    with running() as browser:
        opened = []
        for _ in range(5):  # each with nothing in any cache
            context = browser.new_context(viewport={"width": 1440, "height": 900})
            tab = context.new_page()
            tab.goto(page.as_uri())
            tab.wait_for_function("window.review && review.drawn")
            opened.append(float(tab.evaluate("review.drawn")))
            if len(opened) < 5:
                context.close()
        steps = tab.evaluate(_STEPPING)
        return {
            "open ms": float(np.median(opened)),
            "step ms": float(np.median(steps)),
            **_played(tab),
        }


_STEPPING = f"""async () => {{
  const took = [];
  for (let i = 0; i < {STEPS}; i++) {{
    await new Promise((done) => setTimeout(done, 40));
    const start = performance.now();
    document.body.dispatchEvent(new KeyboardEvent("keydown", {{ key: "ArrowRight", bubbles: true }}));
    took.push(performance.now() - start);
  }}
  return took;
}}"""


def _played(tab: Tab) -> dict[str, float]:
    """Return frames a second over some seconds, with nothing decoded before, and the longest wait for one."""
    tab.evaluate(
        "() => { window.shownAt = [];"
        "review.transport.listen((what) => { if (what === 'frame') shownAt.push(performance.now()); }); }"
    )
    tab.keyboard.press("Home")
    tab.wait_for_timeout(300)
    tab.evaluate("shownAt.length = 0")
    tab.keyboard.press(" ")
    tab.wait_for_timeout(1000 * PLAYED)
    tab.keyboard.press(" ")
    times: Any = np.array(tab.evaluate("shownAt"))
    gaps = np.diff(times)
    return {"fps": 1000.0 * len(gaps) / (times[-1] - times[0]), "longest gap ms": float(gaps.max())}


def main() -> None:
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            desk = simulated(Path(folder), SHOT.replace("frames: 1-24", f"frames: 1-{FRAMES}"))
            rows = [measured(desk, quality) for quality in sys.argv[1:] or ("draft", "daily")]
        finally:
            os.chdir(before)
    show(f"a review page of {FRAMES} frames", rows)
    targets = [
        Target(str(row["quality"]), what, float(row[name]), **bound)
        for row in rows
        for what, name, bound in (
            ("opens, ms", "open ms", {"most": 1000.0}),
            ("plays, fps", "fps", {"least": 23.5}),
        )
    ]
    show("targets", [target.row for target in targets])
    keep("review", rows)


if __name__ == "__main__":
    main()
