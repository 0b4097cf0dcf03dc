"""The subject `sequence` of a shot file."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from flowsculpt import UsageError
from flowsculpt.api import MovingKind, plural
from flowsculpt.api.meshes import Floats, ModelFile, ScenePart
from flowsculpt.api.shots import Clock, Positive, SurfaceSequence
from flowsculpt.pipeline.plugins.sequences.given_surfaces import (
    EXACT,
    GivenSurfaces,
    SampleTimes,
    looped,
    numbers_of,
)
from flowsculpt.pipeline.plugins.sequences.numbered_files import (
    in_other_format,
    is_pattern,
    listed_numbers,
    numbered_files,
)
from flowsculpt.pipeline.plugins.sequences.surface_samples import (
    MovingSamples,
    NumberedSamples,
    SurfaceSamples,
)


class MeshSequenceDocument(MovingKind):
    """A moving mesh of another program."""

    example = "{sequence: cache/fluid_####.ply}"

    sequence: str = Field(
        description="numbered mesh files beside the shot file, as fluid_####.ply; or a file with an "
        "animation: Alembic, USD, glTF, FBX, PVD, PC2 or MDD"
    )
    rate: Positive | None = Field(
        None, description="files per second; by default as many as the shot has frames (1/s)"
    )
    interval: Positive | None = Field(None, description="from file to file, in place of rate (s)")
    start: Annotated[int, Field(ge=-(10**9), le=10**9)] | None = Field(
        None, description="number of the file in the first frame; by default the frame's own number"
    )
    speed: Annotated[float, Field(ge=-1000, le=1000)] = Field(
        1.0, description="rate of its time; below 0 it runs backwards"
    )
    loop: bool = Field(False, description="begins again after the last file")
    between: Literal["linear", "cubic", "hold"] = Field(
        "linear",
        description="what frames between two files show: vertices on lines or curves, or the file before",
    )
    missing: Literal["refused", "hold"] = Field(
        "refused", description="frames without a file: refused, or the file before is held"
    )
    faces: Literal["fixed", "changing"] | None = Field(
        None, description="whether all files have the same faces; by default as the first and last ones are"
    )
    values: str | None = Field(
        None, description="of VTK files: the array of numbers that look: {measure: {values: {}}} shows"
    )
    mesh: str | None = Field(None, description="of files of points alone, as PC2: the model with their faces")
    prim: str | None = Field(None, description="of USD stages: the path of the prim to read, as /World/Chair")
    animation: str | None = Field(None, description="of files with several animations: the name of one")

    def surfaces(self, folder: Path, clock: Clock) -> SurfaceSequence:
        if self.rate is not None and self.interval is not None:
            raise UsageError("rate and interval both set the time between files. Remove one.")
        find = self._numbered if is_pattern(self.sequence) else self._moving
        times, samples, absent = find(folder, clock)
        asked = None if self.faces is None else self.faces == "fixed"
        seconds, repair = tuple(map(clock.flow_time, clock.frames)), self.repair == "on"
        given = GivenSurfaces(samples, times, self.between, asked, repair, seconds, absent, self.values)
        if self.values is not None:
            if self.faces == "fixed":
                raise UsageError("values are of each file's own faces. Leave faces out, or write changing.")
            numbers_of(samples.surface(times.place(0.0)[0]), self.values, given.path.name)
        return given

    @property
    def _rate(self) -> float | None:
        """Files per second, where the shot says it."""
        if self.interval is not None:
            return 1.0 / self.interval
        return None if self.rate is None else float(self.rate)

    @property
    def _part(self) -> ScenePart | None:
        named = self.prim is not None or self.animation is not None
        return ScenePart(self.prim, animation=self.animation) if named else None

    def _moving(self, folder: Path, clock: Clock) -> tuple[SampleTimes, SurfaceSamples, Absent]:
        """Return the samples of a file with an animation, their times, and what is absent."""
        points = None if self.mesh is None else folder / self.sequence
        file = ModelFile(folder / (self.mesh or self.sequence), self._part)
        moving, of_shot = file.motion(points), float(clock.rate.fps)
        if file.reader is None:
            raise UsageError(f"{self.sequence} has points alone. Write mesh: the model with their faces.")
        known = moving.rate or (of_shot if moving.is_continuous else 1.0 / _interval(moving.times, clock))
        faster = 1.0 if self._rate is None else self._rate / known
        if moving.is_in_frames:  # whose length only the shot says
            known, faster = 1.0, self._rate or of_shot
        begins = float(moving.times[0]) if self.start is None else self.start / known
        first, last = float(moving.times[0]), float(moving.times[-1])
        if not first - EXACT <= begins <= last + EXACT:
            raise UsageError(
                f"start is {self.start}, and the animation has frames {first * known:g} to {last * known:g}, "
                f"{known:g} a second. Write one of these."
            )
        at = np.arange(first, last + EXACT, 1.0 / known) if moving.is_continuous else moving.times
        interval = 1.0 / known if moving.is_continuous else _interval(moving.times, clock)
        samples = MovingSamples(np.asarray(at) - begins, moving, file, begins)
        times = SampleTimes(samples.times, interval, faster * self.speed, None, may_lack=False)
        if self.loop and moving.is_continuous:
            before_end = at[: max(int(np.searchsorted(at, last - EXACT)), 1)] - begins
            times = replace(times, times=before_end, period=max(last - first, interval))
        elif self.loop:
            times = looped(times, samples)
        absent = _absent_time(times, clock, last) if self.missing == "refused" else None
        return times, samples, absent

    def _numbered(self, folder: Path, clock: Clock) -> tuple[SampleTimes, SurfaceSamples, Absent]:
        """Return the samples of numbered files, their times, and what is absent."""
        rate = self._rate or float(clock.rate.fps)
        files = numbered_files(self.sequence, folder)
        numbers = np.array(list(files))
        step, others = _step(numbers), partial(in_other_format, self.sequence, folder)
        if step > 1 and self._rate is None:
            between = {*range(int(numbers[0]), int(numbers[-1]))} - {*files}
            raise UsageError(
                f"the files are numbered {numbers[0]}, {numbers[1]}, … in steps of {step}, and how long a "
                f"step takes is not known. Write rate: {rate:g} for {rate:g} files a second, or interval."
                f"{others(between)}"
            )
        first = clock.frames.first if self.start is None else self.start
        if not numbers[0] <= first <= numbers[-1]:
            whose = "the first frame of the shot" if self.start is None else "start"
            raise UsageError(
                f"{whose} is {first}, and the files are numbered {listed_numbers(files)}. "
                f"Write start: {numbers[0]}, the number of the file that the first frame shows."
            )
        samples = NumberedSamples((numbers - first) / (step * rate), list(files.values()), self._part)
        times = SampleTimes(samples.times, 1.0 / rate, self.speed, None)
        times = looped(times, samples) if self.loop else times
        absent = _absent_files(times, numbers, clock, others) if self.missing == "refused" else None
        return times, samples, absent


Absent = tuple[str, str] | None
"""As of `SurfaceSequence.absent`."""


def _step(numbers: np.ndarray) -> int:
    """Return the step in which files are numbered."""
    return int(np.gcd.reduce(np.diff(numbers))) if len(numbers) > 1 else 1


def _interval(times: Floats, clock: Clock) -> float:
    """Return the seconds between two samples, mostly; of one sample a frame of the shot."""
    return float(np.median(np.diff(times))) if len(times) > 1 else 1.0 / float(clock.rate.fps)


def _absent_time(times: SampleTimes, clock: Clock, last: float) -> Absent:
    """Say where frames show times after the end of an animation, or before it."""
    end = len(times.times) - 1
    for frame in () if times.loops else clock.frames:
        sample, share = times.place(clock.flow_time(frame))
        if share < 0.0 or (sample == end and share > 0.0):
            present = f"{clock.frames.first}-{max(frame - 1, clock.frames.first)}"
            return present, (
                f"frame {frame} shows a time at which the animation, up to {last:g} s of its file, is over. "
                f"Write frames: {present}, missing: hold, or loop: true."
            )
    return None


def _absent_files(
    times: SampleTimes, numbers: np.ndarray, clock: Clock, others: Callable[[Iterable[int]], str]
) -> Absent:
    """Say where frames show times at which no file is there.

    others  returns a sentence about files of such numbers in other formats
    """
    step, lacking, frames = _step(numbers), set[int](), list[int]()
    for frame in clock.frames:
        sample, share = times.place(clock.flow_time(frame))
        is_last = sample == len(numbers) - 1
        if not share or not (share < 0.0 or times.is_gap(sample) or (is_last and not times.loops)):
            continue
        away = round(share * times.length(sample) / times.interval, 6)
        lacking |= {int(numbers[sample]) + step * round(by) for by in {np.floor(away), np.ceil(away)}} - {
            int(number) for number in numbers[sample : sample + 2]
        }
        frames.append(frame)
    if not frames:
        return None
    present = f"{clock.frames.first}-{frames[0] - 1}"
    fact = (
        f"{plural(len(lacking), 'file')} not there: {listed_numbers(lacking)}, for "
        f"{'frame' if len(frames) == 1 else 'frames'} {listed_numbers(frames)}."
        f"{others(lacking)} "
    )
    if frames[0] == clock.frames.first:
        raise UsageError(f"{fact}Write a later start, or missing: hold, which shows the file before.")
    return present, (
        f"{fact}Choose -f {present} of those that are there, write frames: {present}, or missing: hold, "
        "which shows the file before."
    )
