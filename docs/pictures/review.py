"""The pictures of the review page in docs/dailies.md: `make pictures`, or this file.

`--root` says where to render.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from math import cos, sin
from pathlib import Path
from urllib.parse import urlencode

from PIL import Image
from playwright.sync_api import Page

from tests.chromium import fetch, running, wait_for

FOLDER = Path(__file__).parent
SHOT, FRAMES, FRAME = "A010_cube", "33-41", 37
SHOWN = {"frame": FRAME, "a": f"{SHOT} · daily", "b": f"{SHOT} · look clay · daily", "mode": "wipe"}

NOTES = (
    ("Ben", "Silhouette is right. Keep it.", "9"),
    ("Ann", "This fold loses its edge. Open the twist by a few degrees, or let the key reach in.", "8"),
)
CIRCLE = [(0.5 + 0.075 * cos(t / 8), 0.46 + 0.13 * sin(t / 8)) for t in range(53)]
STROKES = (("3", CIRCLE), ("4", [(0.72, 0.2), (0.585, 0.37)]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--root", type=Path, default=Path())
    root = parser.parse_args().root

    def run(*words: str) -> str:
        command = [sys.executable, "-m", "flowsculpt", "--json", "--root", str(root), *words]
        return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout

    run("render", SHOT, "-q", "daily", "-f", FRAMES)
    run("wedge", SHOT, "--vary", "look=clay,glaze", "-q", "daily", "--at", str(FRAME))
    page = Path(json.loads(run("review", SHOT, "-q", "daily"))["page"])
    fetch()
    with running() as browser, tempfile.TemporaryDirectory() as folder:
        tab = browser.new_page(viewport={"width": 1440, "height": 860})
        tab.goto(f"{page.as_uri()}#{urlencode(SHOWN)}")
        wait_for(tab, "window.review && review.cache.get(review.a.url(review.transport.frame))")
        tab.wait_for_timeout(1500)  # until all of the strip is decoded
        save(tab, Path(folder), "review")
        write_notes(tab)
        save(tab, Path(folder), "notes")


def save(tab: Page, folder: Path, name: str) -> None:
    """Save a picture of the page as WebP."""
    tab.screenshot(path=str(folder / f"{name}.png"))
    with Image.open(folder / f"{name}.png") as picture:
        picture.convert("RGB").save(FOLDER / f"{name}.webp", quality=88, method=6)


def write_notes(tab: Page) -> None:
    """Write notes as two reviewers would, and draw over the picture."""
    for key in ("1", "q"):
        tab.keyboard.press(key)
    for author, words, status in NOTES:
        tab.get_by_label("Your name").fill(author)
        for key in ("Tab", "a"):
            tab.keyboard.press(key)
        tab.keyboard.type(words)
        for key in ("Control+Enter", status):
            tab.keyboard.press(key)
    for tool, points in STROKES:
        tab.keyboard.press(tool)
        place = tab.evaluate("review.stage.places()[0]")
        box = tab.locator("#stage").bounding_box()
        assert box is not None
        at = [
            (box["x"] + place["x"] + x * place["width"], box["y"] + place["y"] + y * place["height"])
            for x, y in points
        ]
        tab.mouse.move(*at[0])
        tab.mouse.down()
        for point in at[1:]:
            tab.mouse.move(*point)
        tab.mouse.up()


if __name__ == "__main__":
    main()
