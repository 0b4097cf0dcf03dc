"""The picture of docs/dailies.md: `make pictures`, or this file. `--root` says where to render."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from urllib.parse import urlencode

from PIL import Image

from tests.dailies.review.chromium import fetch, running

OUT = Path(__file__).parent / "review.webp"
SHOT, FRAME = "A010_cube", 37
SHOWN = {"frame": FRAME, "a": f"{SHOT} · daily", "b": f"{SHOT} · look glaze · daily", "mode": "wipe"}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--root", type=Path, default=Path())
    root = parser.parse_args().root

    def run(*words: str) -> str:
        command = [sys.executable, "-m", "pipeline.cli", "--json", "--root", str(root), *words]
        return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout

    run("render", SHOT, "-q", "daily")
    run("wedge", SHOT, "--vary", "look=clay,glaze", "-q", "daily", "--at", str(FRAME))
    page = Path(json.loads(run("review", SHOT, "-q", "daily"))["page"])
    fetch()
    with running() as browser, tempfile.TemporaryDirectory() as folder:
        tab = browser.new_page(viewport={"width": 1440, "height": 860})
        tab.goto(f"{page.as_uri()}#{urlencode(SHOWN)}")
        tab.wait_for_function("window.review && review.isCached(review.transport.frame)")
        tab.wait_for_timeout(1500)  # until all of the strip is decoded
        tab.screenshot(path=f"{folder}/review.png")
        with Image.open(f"{folder}/review.png") as picture:
            picture.convert("RGB").save(OUT, quality=88, method=6)


if __name__ == "__main__":
    main()
