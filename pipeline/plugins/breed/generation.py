"""A generation: candidates tried, the most different chosen, and a folder with their files, sheet and page.

bred/<name>/<name>_01.yaml …     the children, ordinary shot files
bred/<name>/sheet.png            three pictures of each
bred/<name>/index.html           the page on which one chooses
bred/<name>/family.png           all generations up to this one
bred/<name>/generation.json      what was bred, from what, and by which choice
bred/<name>/pictures/…           the last picture of each, for family trees
.flowsculpt/breeding/<digest>/…  trials of a run that has not ended, which the next one takes up
"""

from __future__ import annotations

import json
import os
import signal
import time
import zipfile
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from flowsculpt import FlowsculptError, UsageError
from flowsculpt.api.files import ForkedProcess, atomic_folder, atomic_write, remove_tree
from flowsculpt.api.frames import Folders
from flowsculpt.api.pictures import ContactSheet, Font, write_still
from flowsculpt.api.shots import Shot
from flowsculpt.pipeline.plugins.breed.breeding import Child, Litter, child_of
from flowsculpt.pipeline.plugins.breed.family_tree import PICTURES, RECORD, family_picture
from flowsculpt.pipeline.plugins.breed.generation_page import PageChild, page_text
from flowsculpt.pipeline.plugins.breed.selection import (
    ALIKE,
    EXPLODES,
    FAINT,
    KEY_PICTURES,
    LEAVES,
    STILL,
    Candidate,
    chosen,
    judged,
)
from flowsculpt.pipeline.plugins.breed.trials import Trial, tried

CHILDREN = 12
"""Children of a generation."""

COLUMNS, TEXT = 3, 30
"""Children in a row of the sheet, and the size of its letters in pixels."""

TRIALS = Folders.of_root(Path()).state / "breeding"
"""Folder of the trials of runs that have not ended."""

KEPT_SECONDS = 7 * 86400.0
"""Age from which on such trials are removed."""

GENERATIONS = "bred"
"""Folder of generations, in the root."""

DRAFT = ".breeding-"
"""Begins the names of folders that are not finished."""

INVALID = "does not validate"

_PLURALS = {
    EXPLODES: "explode",
    LEAVES: "leave the picture",
    STILL: "hardly move",
    FAINT: "hardly show",
    ALIKE: "look like another",
    INVALID: "do not validate",
}

Bars = Callable[[], AbstractContextManager[Callable[[str, int], Callable[[], None]]]]


@dataclass(frozen=True, eq=False)
class Bred:
    """A generation that was written.

    children  the names of the chosen, in the order of the sheet
    left_out  how many candidates were left out, by the reason
    """

    folder: Path
    children: tuple[str, ...]
    left_out: Counter[str]


@dataclass(frozen=True, eq=False)
class Breeding:
    """One run of the command.

    litter      its folder is that of the generation
    shots       the parents
    root        of the project
    candidates  how many are tried
    favourites  names of shots that a person liked in the generation before
    """

    litter: Litter
    shots: tuple[Shot, ...]
    root: Path
    candidates: int
    processes: int
    favourites: tuple[str, ...] = ()

    def write(self, bars: Bars) -> Bred:
        """Try all candidates, choose, and write the folder, whole or not at all.

        bars  as `progress_bars` yields: adds a bar by name and total, and returns what advances it

        Raises UsageError where no candidate is left, MachineError where the disk refuses.
        """
        place = self.litter.folder
        with atomic_folder(place, DRAFT) as draft:
            litter = replace(self.litter, folder=place.with_name(draft.name))
            numbers = range(1, self.candidates + 1)
            made = {number: child_of(litter, number, f"{place.name}_{number:02}") for number in numbers}
            children = {number: child for number, child in made.items() if child is not None}
            self._try_all(children, bars)
            parents = [self._trial(f"parent_{k}", shot) for k, shot in enumerate(self.shots, 1)]
            trials = {number: self._trial(f"{number:03}", child.shot) for number, child in children.items()}
            found, left_out = self._chosen(parents, trials)
            if len(children) < self.candidates:
                left_out[INVALID] = self.candidates - len(children)
            names = [f"{place.name}_{k:02}" for k in range(1, len(found) + 1)]
            pairs = [(children[n], trial) for n in found if (trial := trials[n]) is not None]
            self._fill(draft, names, pairs, [trial for trial in parents if trial is not None], left_out)
        remove_tree(self._cache)
        return Bred(place, tuple(names), left_out)

    def _try_all(self, children: Mapping[int, Child], bars: Bars) -> None:
        """Try all children in as many processes as there are threads, and leave what they found in files.

        Threads would not do: the resampler's kernels are not made to be called by several at once.
        """
        count = self.processes if ForkedProcess.may_start() else 1
        others = [ForkedProcess(partial(_exhaust, self._tried(children, k, count))) for k in range(1, count)]
        try:
            with bars() as add:
                advance, told = add("trying", len(children)), 0
                for _ in self._tried(children, 0, count):
                    done = len([*self._cache.glob("[0-9]*.npz")])
                    for _ in range(done - told):
                        advance()
                    told = max(done, told)
        finally:
            for other in others:
                other.send_signal(signal.SIGTERM)
                other.wait()

    def _tried(self, children: Mapping[int, Child], process: int, count: int) -> Iterator[int]:
        """Try what no other process has tried yet, and yield the numbers of all; each begins elsewhere."""
        numba.set_num_threads(max(1, numba.config.NUMBA_NUM_THREADS // count))
        begin = process * len(children) // count
        for number in [*[*children][begin:], *[*children][:begin]]:
            if not self._file(f"{number:03}").exists():
                self._trial(f"{number:03}", children[number].shot)
            yield number

    def _trial(self, name: str, shot: Shot) -> Trial | None:
        """Return a trial, from the run before if that was interrupted; None for one that explodes."""
        file = self._file(name)
        with suppress(OSError, EOFError, ValueError, TypeError, KeyError, zipfile.BadZipFile, zlib.error):
            with file.open("rb") as content, np.load(content, allow_pickle=False) as stored:
                arrays = dict(stored)
            return None if arrays.keys() == {"explodes"} else Trial.of(arrays)
        try:
            trial = tried(shot)
        except (FlowsculptError, np.linalg.LinAlgError):
            trial = None
        arrays = {"explodes": np.array(True)} if trial is None else trial.arrays()
        with atomic_write(file, flush=False) as draft, draft.open("wb") as written:
            np.savez(written, **arrays)
        return trial

    def _file(self, name: str) -> Path:
        return self._cache / f"{name}.npz"

    @property
    def _cache(self) -> Path:
        return self.root / TRIALS / self.litter.digest[:16]

    def _chosen(
        self, parents: Sequence[Trial | None], trials: Mapping[int, Trial | None]
    ) -> tuple[list[int], Counter[str]]:
        """Return the numbers of the chosen, and how many are left out for which reason."""
        before = [trial for trial in parents if trial is not None]
        if not before:
            raise UsageError(f"{self.litter.parents[0].name} explodes itself; breed shots that render")
        judgements: dict[int, Candidate] = {}
        left_out: Counter[str] = Counter()
        for number, trial in trials.items():
            if trial is None:
                left_out[EXPLODES] += 1
                continue
            judgements[number] = judged(trial, before)
            if judgements[number].fault:
                left_out[judgements[number].fault] += 1
        found, alike = chosen(judgements, judged(before[0], before).features, CHILDREN)
        if alike:
            left_out[ALIKE] = len(alike)
        if not found:
            raise UsageError(
                f"no candidate is left of {self.candidates}: {counted(left_out)}. Try another --seed, or "
                f"--change {min(0.6, max(0.1, 0.5 * self.litter.change)):.2g}."
            )
        return found, left_out

    def _fill(
        self,
        folder: Path,
        names: Sequence[str],
        pairs: Sequence[tuple[Child, Trial]],
        parents: Sequence[Trial],
        left_out: Counter[str],
    ) -> None:
        """Write all files of the generation into a folder."""
        litter, name = self.litter, self.litter.folder.name
        for child_name, (child, _) in zip(names, pairs, strict=True):
            (folder / f"{child_name}.yaml").write_text(child.text, encoding="utf-8")
        (folder / PICTURES).mkdir()
        shown = [(child_name, trial) for child_name, (_, trial) in zip(names, pairs, strict=True)]
        shown += [(f"parent_{k}", trial) for k, trial in enumerate(parents, 1)]
        for file, trial in shown:
            write_still(folder / PICTURES / f"{file}.png", _half(trial.pictures[-1]))
        record = {
            "name": name,
            "generation": litter.generation,
            "seed": litter.seed,
            "change": litter.change,
            "parents": [
                {
                    "name": parent.name,
                    "folder": Path(os.path.relpath(parent.folder, litter.folder)).as_posix(),
                }
                for parent in litter.parents
            ],
            "favourites": list(self.favourites),
            "children": [
                {"name": child_name, "candidate": child.number, "changes": list(child.words)}
                for child_name, (child, _) in zip(names, pairs, strict=True)
            ],
            "left_out": dict(left_out),
        }
        (folder / RECORD).write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
        heading = f"{name}: generation {litter.generation} of {' and '.join(p.name for p in litter.parents)}"
        write_still(folder / "sheet.png", _sheet(heading, pairs, litter))
        write_still(folder / "family.png", family_picture(folder, litter.folder))
        page = page_text(
            record,
            _shown_path(litter.folder),
            [
                PageChild(n, child.words, child.shot.intent, trial.pictures)
                for n, (child, trial) in zip(names, pairs, strict=True)
            ],
            [(parent.name, trial.pictures) for parent, trial in zip(litter.parents, parents, strict=False)],
        )
        (folder / "index.html").write_text(page, encoding="utf-8")


def _exhaust(numbers: Iterator[int]) -> None:
    for _ in numbers:
        pass


def counted(left_out: Counter[str]) -> str:
    """Return how many were left out and why, in words: `3 explode, 2 hardly move`."""
    return ", ".join(
        f"{count} {reason if count == 1 else _PLURALS[reason]}" for reason, count in left_out.most_common()
    )


def _shown_path(folder: Path) -> str:
    """Return the path of a folder as a command in this folder names it."""
    with suppress(ValueError):
        return folder.resolve().relative_to(Path.cwd()).as_posix()
    return folder.as_posix()


def _sheet(heading: str, pairs: Sequence[tuple[Child, Trial]], litter: Litter) -> NDArray[Any]:
    """Draw three pictures of each child in a row, three children side by side."""
    rows = [np.concatenate([trial.pictures[k] for k in KEY_PICTURES], axis=1) for _, trial in pairs]
    width, height, font = rows[0].shape[1], rows[0].shape[0], Font("DroidSans", TEXT)
    lines = [font.wrap(", ".join(child.words), width - 2 * TEXT, 2) for child, _ in pairs]
    captions = [
        tuple((str(k) if row == 0 else "", text) for row, text in enumerate([*texts, ""][:2]))
        for k, texts in enumerate(lines, 1)
    ]
    sheet = ContactSheet(heading, captions, (width, height), min(COLUMNS, len(rows)))
    return sheet.picture(rows, f"seed {litter.seed} · change {litter.change:g}")


def _half(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a picture at half its size."""
    height, width = (side // 2 for side in picture.shape[:2])
    blocks = picture[: 2 * height, : 2 * width].reshape(height, 2, width, 2, 3)
    return np.asarray(blocks.mean(axis=(1, 3)).round(), np.uint8)


def unneeded_trials(root: Path, requests: object) -> tuple[str, list[Path]]:
    """Return what interrupted runs left: trials, and drafts where generations are by default.

    None runs while `clean` has the root for itself.
    """
    left = (root / TRIALS, *(root / GENERATIONS).glob(f"{DRAFT}*"))
    return "trials of breed", sorted(path for folder in left for path in folder.rglob("*") if path.is_file())


def forget_interrupted(root: Path, generations: Path) -> None:
    """Remove what runs left that were interrupted or killed long ago: trials, and drafts of generations."""
    for folder in (*(root / TRIALS).glob("*"), *generations.glob(f"{DRAFT}*")):
        with suppress(OSError):
            if time.time() - folder.stat().st_mtime > KEPT_SECONDS:
                remove_tree(folder)
