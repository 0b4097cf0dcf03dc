"""`python -m benchmarks.found_models [--folder DIR] [--only NAME] [--pictures DIR]`: models as found.

Each of the models that `sample_models` makes, and each model file in DIR, is shown under twist, vortex,
Lorenz and curl noise in the shot that `flowsculpt new --model` writes. Models of unusual size or place, and
those of DIR, are shown once more in a plain shot: without `fit`, with edges of 1/24 of the model. `validate`
is asked about each shot, then frame 12 is previewed in a process of its own.

Seconds are processor time shared by two cores; "why" stands for a preview that took over a minute or failed,
and said why. A verdict is true where a good shot is drawn in a minute, and one with an error is not drawn.
`floor` is the largest distance of a lowest point from the stage's floor, over the extent. Writes
`benchmarks/out/found_models.json`, and all that was said beside it.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from argparse import ArgumentParser
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.report import OUT, Row, Target, keep, show
from benchmarks.sample_models import MODELS, UNUSABLE, UNUSUAL
from flowsculpt.pipeline.errors import FlowsculptError
from flowsculpt.pipeline.frames import FrameRange
from flowsculpt.pipeline.mesh.read import ModelFile, read_polygons
from flowsculpt.pipeline.plugins.authoring.first_frame import FirstFrames
from flowsculpt.pipeline.plugins.authoring.scene_rules import findings
from flowsculpt.pipeline.plugins.authoring.shot_templates import model_template, shot_of_flow
from flowsculpt.pipeline.plugins.preview.animatic import Animatic
from flowsculpt.pipeline.plugins.preview.sketch import Sketch
from flowsculpt.pipeline.plugins.preview.surface_stream import SurfaceStream
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.shot import read_shot

FLOWS = {
    "twist": "twist: {axis: y, amount: {keys: {1: 0, 24: 90}}}",
    "vortex": "vortex: {axis: y, strength: 4}",
    "lorenz": "lorenz: {}",
    "curl_noise": "curl_noise: {}",
}

FRAME, SECONDS, CORES, LIMIT = 12, 60.0, 2, 200.0
"""The previewed frame, the seconds that it may take on so many cores, and by the clock on a busy machine."""

PLAIN = """title: {name}
frames: 1-24
subject: {{model: {reference}}}
resample: {{max_edge_length: {edge:.2g}}}
flows: [{{{flow}}}]
look: clay
"""


@dataclass
class Trial:
    """What became of one shot.

    verdict  of validate: good, warning or error
    told     its messages, and those of the preview
    seconds  of the preview; None where it failed or took over SECONDS
    floor    distance of the lowest point from the stage's floor, over the extent
    overtime seconds of a preview that took over SECONDS
    """

    model: str
    flow: str
    fitted: bool
    verdict: str
    told: list[str]
    seconds: float | None = None
    floor: float | None = None
    vertices: int = 0
    overtime: float | None = None

    @property
    def outcome(self) -> float | str:
        """Seconds, or else whether it was said why there are none."""
        return self.seconds if self.seconds is not None else "why" if self.told else "SILENT"

    @property
    def is_true(self) -> bool:
        """Tell whether the verdict foretold the preview."""
        drawn = self.seconds is not None
        if self.verdict == "good":
            return drawn
        return bool(self.told) and not (self.verdict == "error" and drawn)


def write_shot(folder: Path, model: str, file: Path, flow: str, fitted: bool) -> Path:
    """Write the shot of a model under a flow into a folder. Raises FlowsculptError for an unusable model."""
    path = folder / f"{file.stem}_{flow}_{'fitted' if fitted else 'plain'}.yaml"
    if fitted:
        path.write_text(shot_of_flow(flow, path.stem, model_template(file, file.name)))
        return path
    try:
        points = read_polygons(file).vertices
        edge = float(np.ptp(points, axis=0).max()) / 24.0
    except FlowsculptError:
        edge = 0.1
    path.write_text(PLAIN.format(name=path.stem, reference=file.name, edge=edge, flow=FLOWS[flow]))
    return path


def verdict(path: Path, first_frames: FirstFrames) -> tuple[str, list[str]]:
    """Return what `validate` says of a shot."""
    try:
        shot = read_shot(path)
        found = findings(shot, first_frames.of(shot.motion))
    except FlowsculptError as error:
        return "error", [str(error)]
    kind = "error" if any(f.is_error for f in found) else "warning" if found else "good"
    return kind, [finding.text for finding in found]


def preview(root: Path, path: Path, picture: Path) -> dict[str, Any]:
    """Draw frame 12 of a shot; return seconds, vertices and the gap to the floor. Raises FlowsculptError."""
    started = time.process_time()
    request = Project(root, 2).request(path, "draft", FrameRange([FRAME]), variant="none")
    with SurfaceStream(Project(root, 2).store) as stream:
        stream.callback = lambda progress: print(progress.slow, flush=True) if progress.slow else None
        animatic = Animatic(Sketch(request), stream)
        framing = animatic.still(FRAME, picture, lambda stage, number: None)
        seconds = (time.process_time() - started) / CORES
        points = stream.arrays(request, FRAME)["vertices"]
    gap = float(points[:, 1].min() - framing.placement.origin[1])
    return {"seconds": seconds, "floor": gap / float(np.ptp(points, axis=0).max()), "vertices": len(points)}


def tried(trial: Trial, root: Path, path: Path, picture: Path) -> Trial:
    """Preview a shot in a process of its own."""
    words = [sys.executable, "-m", "benchmarks.found_models", "--child", str(path), str(picture)]
    home = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
    child = subprocess.Popen(
        words, cwd=root, env=home, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    try:
        said, _ = child.communicate(timeout=LIMIT)
    except subprocess.TimeoutExpired:
        child.kill()
        said, _ = child.communicate()
    lines = said.splitlines()
    try:
        facts = json.loads(lines[-1]) if child.returncode == 0 else {}
    except (ValueError, IndexError):
        facts = {}
    trial.told += lines[: -1 if facts else None]
    if facts and facts["seconds"] > SECONDS:
        trial.overtime = facts["seconds"]
    elif facts:
        trial.seconds, trial.floor, trial.vertices = facts["seconds"], facts["floor"], facts["vertices"]
    print(f"{path.stem}: {trial.verdict}, {trial.outcome}", flush=True)
    return trial


def trials(folder: Path, models: dict[str, Path], pictures: Path, cores: int) -> list[Trial]:
    """Try all models under all flows, fitted and as they are."""
    shots = folder / "shots"
    waiting: list[tuple[Trial, Path | None]] = []
    first_frames = FirstFrames()
    for model, file in models.items():
        for fitted in (True, False) if model in UNUSUAL or model not in MODELS else (True,):
            for flow in FLOWS:
                try:
                    path = write_shot(shots, model, file, flow, fitted)
                except FlowsculptError as error:
                    waiting.append((Trial(model, flow, fitted, "error", [str(error)]), None))
                    continue
                waiting.append((Trial(model, flow, fitted, *verdict(path, first_frames)), path))
        print(f"validated {model}", flush=True)
    with ThreadPoolExecutor(cores) as pool:
        done = [
            pool.submit(tried, trial, folder, path, pictures / f"{path.stem}.png")
            for trial, path in waiting
            if path is not None
        ]
        for trial in done:
            trial.result()
    return [trial for trial, _ in waiting]


def rows_of(many: list[Trial]) -> list[Row]:
    """Return a row for each model, fitted and as it is."""
    rows: list[Row] = []
    for model, fitted in dict.fromkeys((trial.model, trial.fitted) for trial in many):
        mine = [trial for trial in many if (trial.model, trial.fitted) == (model, fitted)]
        drawn = [trial for trial in mine if trial.seconds is not None]
        row: Row = {"model": model, "shot": "fitted" if fitted else "plain"}
        row["validate"] = "/".join(dict.fromkeys(trial.verdict for trial in mine))
        row |= {trial.flow: trial.outcome for trial in mine}
        row["vertices"] = float(max((trial.vertices for trial in drawn), default=0))
        row["floor"] = max((abs(trial.floor or 0.0) for trial in drawn), default=0.0)
        row["true"] = "yes" if all(trial.is_true for trial in mine) else "NO"
        rows.append(row)
    return rows


def main(arguments: list[str] | None = None) -> list[Target]:
    parser = ArgumentParser(prog="python -m benchmarks.found_models")
    parser.add_argument("--folder", type=Path, help="more models: every model file in this folder")
    parser.add_argument("--only", help="models whose name holds this text")
    parser.add_argument("--pictures", type=Path, help="keep the pictures in this folder")
    given = parser.parse_args(arguments or [])
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "shots").mkdir()
        pictures = (given.pictures or folder / "pictures").resolve()
        pictures.mkdir(parents=True, exist_ok=True)
        models = {model: write(folder / "shots") for model, write in MODELS.items()}
        for file in sorted(given.folder.iterdir()) if given.folder else ():
            if ModelFile(file).reader is not None:
                models[file.name] = Path(shutil.copy(file, folder / "shots"))
        models = {model: file for model, file in models.items() if not given.only or given.only in model}
        many = trials(folder, models, pictures, max(1, (os.cpu_count() or 1) // 2))
    rows = rows_of(many)
    show("Models as they are found", rows)
    targets = targets_of(many)
    show("Targets", [target.row for target in targets])
    OUT.mkdir(exist_ok=True)
    keep("found_models", [*rows, *(target.row for target in targets)])
    (OUT / "found_models_told.json").write_text(json.dumps([asdict(trial) for trial in many], indent=1))
    return targets


def targets_of(many: list[Trial]) -> list[Target]:
    untrue = sum(not trial.is_true for trial in many)
    silent = sum(trial.outcome == "SILENT" for trial in many)
    fitted = [trial.seconds is not None for trial in many if trial.fitted and trial.model not in UNUSABLE]
    gap = max((abs(trial.floor or 0.0) for trial in many), default=0.0)
    return [
        Target("models", "verdicts that are not true", float(untrue), most=0.0),
        Target("models", "previews neither drawn nor explained", float(silent), most=0.0),
        Target("fitted", "share drawn within a minute", sum(fitted) / max(1, len(fitted)), least=0.98),
        Target("models", "gap to the floor, of the extent", gap, most=0.01),
    ]


def child(path: Path, picture: Path) -> int:
    """Preview one shot; print its facts, or why there are none."""
    try:
        facts = preview(Path(), path, picture)
    except FlowsculptError as error:
        print(error)
        return error.exit_code
    print(json.dumps(facts))
    return 0


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        sys.exit(child(Path(sys.argv[2]), Path(sys.argv[3])))
    main(sys.argv[1:])
