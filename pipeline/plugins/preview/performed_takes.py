"""Takes: values of a shot over time as they were performed, each in a file of its own beside the shots.

A take is whole or not there, and is never written again. Its keys are put into the shot file when it is
chosen; the shot renders without it. While a take is recorded, its samples are kept in a folder beside, in a
file for each second; a later process finds those of a process that was killed.
"""

from __future__ import annotations

import glob
import json
import os
import re
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import psutil
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from flowsculpt import FlowsculptError, UsageError
from flowsculpt.api.files import ChangedFileError, InputFile, atomic_write, make_folder, remove_tree
from flowsculpt.pipeline.plugins.preview.curve_fitting import FittedCurve, fit
from flowsculpt.pipeline.plugins.preview.text_edits import Where

MOST_BYTES = 64 << 20  # of a take: an hour of ten values at 120 samples a second

MOST_TAKES = 999  # of one shot

RECORDING = ".recording."  # between the shot and the process in the name of a folder with a take under way

TOLERANCE = 0.01  # the distance of a sample from the fitted curve, over the range of the samples

PER_FRAME = 2  # values between samples that are fitted too: the shot was seen with them

PathStep = str | int | float


class _Document(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True)


class RecordedValue(_Document):
    """The samples of one value of a shot."""

    where: list[PathStep] = Field(min_length=1, description="the path of the value in the shot file")
    source: str = Field(description="what moved it, such as pointer, midi cc 1 or osc /fader/1")
    times: list[float] = Field(
        description="of the samples, ascending: frames, as the keys of the value count them"
    )
    samples: list[list[float]] = Field(description="the value at each time: one number, or three of a vector")
    before: Any = Field(None, description="what the file had; null where it left the value out")

    @model_validator(mode="after")
    def _check(self) -> RecordedValue:
        widths = {len(row) for row in self.samples}
        if len(self.samples) != len(self.times) or len(widths) > 1 or not widths <= {1, 3}:
            raise ValueError("there must be a sample for each time, and each of one number or of three")
        if any(b < a for a, b in zip(self.times, self.times[1:], strict=False)):
            raise ValueError("times must ascend")
        return self


class PerformedValue(RecordedValue):
    """The samples of one value of a shot, and the keys that were fitted to them."""

    keys: list[FileKey] = Field(min_length=1, description="that were fitted to the samples")
    error: float = Field(ge=0, description="largest distance of a sample from the keys, over the range")

    @model_validator(mode="after")
    def _check_keys(self) -> PerformedValue:
        if len(self.times) < 2 or {len(key.row) for key in self.keys} != {len(self.samples[0])}:
            raise ValueError("there must be two samples, and keys as long as a sample")
        return self

    @property
    def span(self) -> tuple[float, float]:
        """The frames of its first and last key."""
        return self.keys[0].time, self.keys[-1].time


class FileKey(_Document):
    """A key as the shot file has it: `time: {value: …, left: [time, value], right: [time, value]}`."""

    time: float
    value: float | list[float]
    left: Annotated[list[Any], Field(min_length=2, max_length=2)] | None = None
    right: Annotated[list[Any], Field(min_length=2, max_length=2)] | None = None

    @property
    def row(self) -> list[float]:
        return self.value if isinstance(self.value, list) else [self.value]

    @property
    def data(self) -> dict[str, Any]:
        """The key as plain data of a shot file."""
        named = {"value": self.value, "left": self.left, "right": self.right}
        return {name: value for name, value in named.items() if value is not None}


class Take(_Document):
    """Values of a shot that were performed together."""

    version: Literal[1] = 1
    shot: str = Field(description="name of the shot that it was performed on")
    fps: float = Field(gt=0, description="frames a second of the shot")
    speed: float = Field(gt=0, description="at which it was performed: 1 is the speed of the film")
    values: list[PerformedValue]

    def value_at(self, where: Sequence[PathStep]) -> PerformedValue | None:
        """Return the samples of a value; None where the take has none."""
        return next((each for each in self.values if each.where == list(where)), None)


class Recorded(_Document):
    """A take that is not ended yet, or what a second of it has added."""

    shot: str
    fps: float = Field(gt=0)
    speed: float = Field(gt=0)
    whole: bool = Field(description="whether keys are put on whole frames only")
    values: list[RecordedValue]

    @classmethod
    def joined(cls, seconds: Sequence[Recorded]) -> Recorded:
        """Return all that these seconds, at least one, have added."""
        values = []
        for each in zip(*(second.values for second in seconds), strict=True):
            times, samples = (
                [x for value in each for x in getattr(value, name)] for name in ("times", "samples")
            )
            values.append(each[-1].model_copy(update={"times": times, "samples": samples}))
        return seconds[-1].model_copy(update={"values": values})

    def take(self) -> Take | None:
        """Return the take, with keys that fit; None where nothing was moved."""
        values = [
            performed(value.where, value.source, value.times, value.samples, value.before, self.whole)
            for value in self.values
            if value.times
        ]
        return Take(shot=self.shot, fps=self.fps, speed=self.speed, values=values) if values else None


PerformedValue.model_rebuild()
Take.model_rebuild()


def performed(
    where: Sequence[PathStep],
    source: str,
    times: Sequence[float],
    samples: Sequence[Sequence[float]],
    before: Any,
    whole: bool = False,
) -> PerformedValue:
    """Return the samples of a value with the keys that fit them to within TOLERANCE of their range.

    whole  put keys on whole frames only
    """
    rows = np.array(samples, np.float64)
    ranges = np.ptp(rows, axis=0)
    reach = float(ranges.max()) or float(np.abs(rows).max()) or 1.0
    ranges = np.where(ranges > 0, ranges, reach)
    ends = np.array([times[0], times[-1]], np.float64)
    if whole:
        ends = np.array([np.floor(ends[0]), np.ceil(ends[1])])
    dense = np.union1d(np.array(times), np.arange(np.ceil(ends[0]), ends[1], 1 / PER_FRAME))
    dense = np.union1d(dense, ends)
    between = np.stack([np.interp(dense, times, column) for column in rows.T], axis=1)
    curve = fit(dense, between, TOLERANCE * (0.97 * ranges), whole)
    return PerformedValue(
        where=list(where),
        source=source,
        times=[round(float(time), 4) for time in times],
        samples=[[_short(x, r) for x, r in zip(row, ranges, strict=True)] for row in rows.tolist()],
        keys=file_keys(curve, ranges),
        error=round(float((curve.error / ranges).max()), 6),
        before=before,
    )


def file_keys(curve: FittedCurve, ranges: np.ndarray) -> list[FileKey]:
    """Return fitted keys as a shot file has them, in as many digits as the range of the values deserves."""
    keys, made = curve.keys, []
    times = [_plain(round(key.time, 3)) for key in keys]
    for i, key in enumerate(keys):
        handles: dict[str, list[Any] | None] = {}
        for side, name in ((-1, "left"), (1, "right")):
            if not 0 <= i + side < len(keys):
                continue
            length = round((times[i + side] - times[i]) / 3.0, 4)
            handles[name] = [_plain(length), _number(key.slope * length, ranges)]
        made.append(FileKey(time=times[i], value=_number(key.value, ranges), **handles))
    return made


def _number(values: np.ndarray, ranges: np.ndarray) -> float | list[float]:
    row = [_short(x, r) for x, r in zip(values.tolist(), ranges.tolist(), strict=True)]
    return row if len(row) > 1 else row[0]


def _short(number: float, reach: float) -> float:
    """Return a number to about a ten-thousandth of a range."""
    digits = max(0, min(12, 4 - int(np.floor(np.log10(reach)))))
    return _plain(round(number, digits))


def _plain(number: float) -> float:
    """Return a number without its sign where it is 0."""
    return float(number) + 0.0


class TakeFolder:
    """The takes beside a shot: `takes/NAME.json`."""

    def __init__(self, shot: Path) -> None:
        self.shot, self.path = shot, shot.parent / "takes"

    def save(self, take: Take) -> str:
        """Write a take under the next free number, and return its name. Raises MachineError, UsageError."""
        make_folder(self.path)
        text = json.dumps(take.model_dump(mode="json", exclude_none=True), separators=(",", ":"))
        for number in range(1, MOST_TAKES + 1):
            path = self.path / f"{self.shot.stem}.{number}.json"
            if path.exists():
                continue
            try:
                with atomic_write(path, is_same=lambda there: not there.exists()) as draft:
                    draft.write_text(text, encoding="utf-8")
            except ChangedFileError:
                continue  # another page, or another process, was faster
            return path.stem
        raise UsageError(f"{self.path}: there are {MOST_TAKES} takes of this shot. Delete some of them.")

    def read(self, name: str) -> Take:
        """Return a take. Raises UsageError where it is damaged, and the errors of `InputFile.content`."""
        if not re.fullmatch(r"[\w.-]{1,120}", name):
            raise UsageError(f"{name[:40]!r} is not the name of a take; one has letters, digits, _, - and .")
        path = self.path / f"{name}.json"
        content = InputFile(path, MOST_BYTES).content()
        try:
            return Take.model_validate_json(content)
        except ValidationError as error:
            first = error.errors()[0]
            place = ".".join(map(str, first["loc"])) or "the file"
            raise UsageError(
                f"{path}: {place}: {first['msg']}. Restore the file, or delete it; shots keep their keys."
            ) from None

    def names(self) -> list[str]:
        """Return the names of takes of this shot, and of shots that are not there any more, in order."""
        found = []
        for path in self.path.glob("*.json"):
            shot, _, number = path.stem.rpartition(".")
            is_ours = shot == self.shot.stem or not (self.shot.parent / f"{shot}.yaml").exists()
            if number.isdigit() and is_ours:
                found.append((shot != self.shot.stem, shot, int(number), path.stem))
        return [name for *_, name in sorted(found)]

    def all(self, known: dict[str, Take]) -> dict[str, Take]:
        """Return the takes by name, except damaged ones. `known` are not read, and get those that are."""
        names = self.names()
        for name in names:
            if name not in known:
                with suppress(FlowsculptError):
                    known[name] = self.read(name)
        return {name: known[name] for name in names if name in known}

    def rescue(self) -> list[str]:
        """Save what was recorded by processes that were killed, and return the names of these takes.

        Raises MachineError, UsageError.
        """
        names = []
        for folder in sorted(self.path.glob(f"{glob.escape(self.shot.stem)}{RECORDING}*")):
            if not _is_under_way(folder) and (take := _rescued(folder)) is not None:
                names.append(self.save(take))
                remove_tree(folder)
        return names


class TakeJournal:
    """Keeps what is recorded until it is a take, in a folder that is named after the process.

    kept  samples that were kept, by the paths of values
    """

    def __init__(self, shot: Path) -> None:
        name = f"{shot.stem}{RECORDING}{os.getpid()}.{time.time_ns()}"
        self._folder, self._seconds = shot.parent / "takes" / name, 0
        self.kept = Counter[Where]()

    def keep(self, second: Recorded) -> None:
        """Keep what a second has added. Raises MachineError."""
        if not any(value.times for value in second.values):
            return
        self._seconds += 1
        make_folder(self._folder)
        with atomic_write(self._folder / f"{self._seconds:06}.json", flush=False) as draft:
            draft.write_text(second.model_dump_json(), encoding="utf-8")
        self.kept.update({tuple(value.where): len(value.times) for value in second.values})

    def end(self) -> None:
        """Forget all: it is in a take."""
        remove_tree(self._folder)


def _is_under_way(folder: Path) -> bool:
    """Tell whether the process that records into a folder is still there."""
    try:
        process = psutil.Process(int(folder.name.rpartition(RECORDING)[2].partition(".")[0]))
        return process.create_time() <= folder.stat().st_mtime
    except (ValueError, OverflowError, OSError, psutil.Error):
        return False


def _rescued(folder: Path) -> Take | None:
    """Return the take that the seconds in a folder make, up to a damaged one; None where there is none."""
    seconds: list[Recorded] = []
    with suppress(FlowsculptError, ValueError):
        for path in sorted(folder.glob("*.json")):
            seconds.append(Recorded.model_validate_json(InputFile(path, MOST_BYTES).content()))
    with suppress(ValueError):  # they are not of one recording
        return Recorded.joined(seconds).take() if seconds else None
    return None
