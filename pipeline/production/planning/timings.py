"""How long frames took here, and how large they became: what an estimate goes by."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from pathlib import Path

from pipeline.production.request.crop_and_scale import base_of, quality_named
from pipeline.production.store.event_log import EventReader, logs_of
from render.scene.quality import QUALITIES

RUNS = 30
"""How many of the latest runs are looked at."""

FRAMES = 100
"""How many frames of one kind are looked at."""

OF_MOTION = frozenset({"simulate", "smooth_normals", "frame_camera"})
"""Stages that take as long at every quality."""

_KINDS = {"simulate": "meshes", "smooth_normals": "normals", "render": "raw", "finish": "frames"}


@dataclass(frozen=True)
class Sample:
    """Frames that were measured: seconds of a core each, the mean, and how many they were.

    of  where they were made, to be told: `A010_cube at draft`
    """

    seconds: float
    frames: int
    of: str


class Measured:
    """Of a root folder."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._statistics: dict[Path, list[tuple[float, float]]] = {}

    def seconds(self, stage: str, shot: str, quality: str) -> Sample | None:
        """Of a frame: of the same shot and quality or, if there are none, of another, by its light or pixels.

        None where nothing of the stage was measured here.
        """
        if stage == "render":
            return self._of_rendering(shot, quality)
        known = self._told.get(stage, {})
        places = sorted(known, key=lambda place: (place[0] != shot, place[1] != quality))
        if not places:
            return None
        found = places[0]
        scale = 1.0 if stage in OF_MOTION else pixels(quality) / pixels(found[1])
        taken = known[found]
        return Sample(scale * sum(taken) / len(taken), len(taken), f"{found[0]} at {found[1]}")

    def _of_rendering(self, shot: str, quality: str) -> Sample | None:
        """Of the same shot and quality or, where none is known, of the nearest: light goes by samples, all by
        pixels."""
        for name, at in ((shot, quality), (shot, "*"), ("*", quality), ("*", "*")):
            for place in _folders(self._root, name, at):
                if place not in self._statistics:
                    self._statistics[place] = list(_seconds_in(place))
                taken, known = self._statistics[place], place.parent.name
                if taken:
                    more = samples(quality) / samples(known)
                    each = sum(more * light + rest for light, rest in taken) / len(taken)
                    scale = pixels(quality) / pixels(known)
                    return Sample(scale * each, len(taken), f"{place.parents[1].name} at {known}")
        return None

    def bytes(self, stage: str, shot: str, quality: str) -> float | None:
        """Of the file that a stage makes of a frame; None where none was made here."""
        kind = _KINDS.get(stage)
        if kind is None:
            return 0.0
        home = self._root / "renders"
        if stage in OF_MOTION:
            own, others = f"{shot}/{kind}/*", f"*/{kind}/*"
            size = _mean_size(home, own)
            return _mean_size(home, others) if size is None else size
        for pattern in (f"{shot}/{quality}", f"*/{quality}", "*/*"):
            folder = next((file.parent for file in home.glob(f"{pattern}/{kind}/*.exr")), None)
            if folder is not None:
                size = _mean_size(folder, "*.exr")
                assert size is not None, "there is one at least"
                return size * pixels(quality) / pixels(folder.parent.name)
        return None

    @cached_property
    def _told(self) -> dict[str, dict[tuple[str, str], list[float]]]:
        """Of the other stages, by the event logs."""
        found: dict[str, dict[tuple[str, str], list[float]]] = defaultdict(lambda: defaultdict(list))
        for log in logs_of(self._root)[-RUNS:]:
            threads: dict[str, int] = {}
            for event in EventReader(log).new():
                if event["event"] == "begin":
                    threads[event["job"]] = int(event.get("threads", 1))
                elif event["event"] == "frame" and not event["found"]:
                    said = event.get("quality", "draft")
                    quality = said if base_of(said) in QUALITIES else "draft"
                    taken = float(event["seconds"]) * threads.get(event["job"], 1)
                    found[event["stage"]][event["shot"], quality].append(taken)
        return found


def samples(quality: str) -> int:
    return quality_named(quality, QUALITIES).samples


def pixels(quality: str) -> int:
    named = quality_named(quality, QUALITIES)
    if named.crop is None:
        return named.width * named.height
    x0, y0, x1, y1 = named.crop
    return (x1 - x0) * (y1 - y0)


def _folders(root: Path, name: str, quality: str) -> Iterator[Path]:
    """Where statistics lie of pictures of a quality that is known."""
    for home in (root / "renders", root / "renders" / "turntable"):
        for folder in sorted(home.glob(f"{name}/{quality}/statistics")):
            if base_of(folder.parent.name) in QUALITIES:
                yield folder


def _seconds_in(folder: Path) -> Iterator[tuple[float, float]]:
    """Of a core, of light and of all else, of frames that one process rendered from their first pass on."""
    for path in islice(folder.glob("*.json"), FRAMES):
        try:
            told = json.loads(path.read_text())
            if not told.get("resumed_batches"):
                light = told["seconds"].pop("rendering") * told["threads"]
                yield light, sum(told["seconds"].values()) * told["threads"]
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            continue


def _mean_size(folder: Path, pattern: str) -> float | None:
    sizes = list(_sizes(islice(folder.glob(pattern), FRAMES)))
    return sum(sizes) / len(sizes) if sizes else None


def _sizes(files: Iterator[Path]) -> Iterator[int]:
    for file in files:
        try:
            yield file.stat().st_size
        except OSError:
            continue
