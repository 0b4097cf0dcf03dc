"""`python -m benchmarks.taken_in_again SHOT LAST [QUALITY]`: our own frames, taken in again.

The frames 1 to LAST of a shot of the gallery are exported as USD and PLY with velocities, and as Alembic,
which has one mesh for all of them, and taken in again by `sequence` in the same scene, under the same name,
which decides the samples of pixels. All are rendered with motion blur, with `--first` only from that frame
on, with `--scale` smaller, and their frames compared: PSNR, dB, of the worst, and flicker: the mean change
from frame to frame over that of the original. `name` is the original itself under another name: how far two
renders are apart by their noise. Writes `benchmarks/out/taken_in_again.json`, and with `--pictures` the
frames of all.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from argparse import ArgumentParser
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from imageio import v3 as imageio

from benchmarks.first_film import CHECKOUT, run
from benchmarks.measured_shots import copy_shots
from benchmarks.report import Target, keep, show
from flowsculpt.pipeline.arrays import Floats

SEQUENCES = {
    "usd": "usd/{shot}.usda, prim: /{shot}/sculpture",
    "ply": "models/{shot}.####.ply",
    "abc": "models/{shot}.abc",
}

OF_SUBJECT = ("resample", "flows", "become", "placement")
"""Entries of a shot that make its surface."""


def main() -> None:
    parser = ArgumentParser()
    parser.add_argument("shot")
    parser.add_argument("last", type=int)
    parser.add_argument("quality", nargs="?", default="daily")
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--scale", default="100%")
    parser.add_argument("--formats", nargs="+", choices=[*SEQUENCES, "name"], default=list(SEQUENCES))
    parser.add_argument("--pictures", type=Path)
    words = parser.parse_args()
    targets = []
    shown = ["-q", words.quality, "-f", f"{words.first}-{words.last}", "--scale", words.scale]
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder) / "original"
        copy_shots(root)
        path = root / f"shots/{words.shot}.yaml"
        shot = {**yaml.safe_load(path.read_text()), "frames": f"1-{words.last}", "shutter": {"angle": 180}}
        path.write_text(yaml.safe_dump(shot))
        original = rendered(root, words.shot, shown)
        for form in words.formats:
            if form == "name":
                shutil.copy(path, path.with_name(f"{words.shot}_2.yaml"))
                again = rendered(root, f"{words.shot}_2", shown)
            else:
                command(root, "export", form, words.shot)
                place = f"../../original/renders/{words.shot}/{SEQUENCES[form].format(shot=words.shot)}"
                write_again(root.with_name(form), words.shot, shot, place)
                again = rendered(root.with_name(form), words.shot, shown)
            errors = ((original - again) ** 2).mean(axis=(1, 2, 3))
            psnr = -10.0 * np.log10(float(errors.max()) + 1e-12)
            changes, changed = (float(np.abs(np.diff(film, axis=0)).mean()) for film in (original, again))
            work = f"{words.shot} as {form}"
            least, most = (None, None) if form == "name" else (45.0, 1.05)
            targets.append(Target(work, "PSNR, dB, of the worst frame", psnr, least=least))
            targets.append(Target(work, "flicker, over the original", changed / changes, most=most))
        if words.pictures:
            shutil.copytree(folder, words.pictures, dirs_exist_ok=True)
    rows = [target.row for target in targets]
    show("Frames taken in again", rows)
    keep("taken_in_again", rows)


def command(root: Path, *words: str) -> None:
    """Run flowsculpt. Raises CalledProcessError where it fails."""
    run([CHECKOUT / ".venv/bin/flowsculpt", "--no-progress", *words], root, dict(os.environ))


def write_again(root: Path, name: str, shot: dict[str, Any], sequence: str) -> None:
    """Write a shot of the files of another, in its scene."""
    scene = {key: value for key, value in shot.items() if key not in OF_SUBJECT}
    scene["subject"] = yaml.safe_load(f"{{sequence: {sequence}}}")
    (root / "shots").mkdir(parents=True)
    (root / f"shots/{name}.yaml").write_text(yaml.safe_dump(scene))


def rendered(root: Path, name: str, options: list[str]) -> Floats:
    """Render frames of a shot; return them (T, H, W, 3), display values from 0 to 1."""
    command(root, "stills", name, *options)
    files = sorted((root / f"renders/{name}").glob("**/png/*.png"))
    return np.stack([imageio.imread(file)[..., :3] / 255.0 for file in files])


if __name__ == "__main__":
    main()
