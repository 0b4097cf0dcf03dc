"""The command `audit`: make some finished frames again, from nothing, and compare them bit by bit."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from flowsculpt import MachineError, MissingInputError, UsageError
from flowsculpt.api import plural
from flowsculpt.api.commands import Project, execute, print_result, report_plan
from flowsculpt.api.files import remove_tree
from flowsculpt.api.frames import Folders, FrameKeys, FrameRange, Locks, Plan, RenderRequest, Store
from flowsculpt.api.options import DEFAULT_QUALITY, Common, Frames, PictureOptions, Quality, Shot
from flowsculpt.api.pictures import RenderError, read_exr


def audit(
    common: Common,
    shot: Shot,
    options: PictureOptions,
    share: Annotated[
        str, typer.Option(metavar="PERCENT", help="The share of finished frames to make again. At least one.")
    ] = "1%",
    seed: Annotated[int, typer.Option(metavar="N", help="Another number chooses other frames.")] = 0,
    frames: Frames = None,
    quality: Quality = DEFAULT_QUALITY,
) -> None:
    """Make random finished frames of a shot again, and compare every value of every layer.

    `flowsculpt audit A010_cube -q final --share 1%` chooses frames at random, the same ones for the same
    --seed, and makes them again below .flowsculpt/audit from the shot file alone: meshes, cameras, pictures.
    With --profile, other machines do. The exit code is 1 where a frame has other values; the new frames are
    kept then. A frame whose file cannot be read counts as different.
    """
    part = _share(share)
    project = options.project(common)
    request = project.find_request(shot, options.quality(quality, project, [shot]), frames)
    of_shot = project.as_finished(request)
    audited = Audit(project, of_shot, finished_frames(of_shot, project.store))
    chosen = audited.chosen(part, seed)
    inside = common.with_own_root(audited.home)
    if common.dry_run:
        report_plan(inside, audited.plan(chosen))
        return
    with Locks(project.root).hold(audited.lock, common.wait):
        remove_tree(audited.home)
        outcome = execute(inside, lambda: audited.plan(chosen))
        compared = audited.compared(chosen)
        is_same = all(frame.is_same for frame in compared)
        if is_same:
            remove_tree(audited.home)
    facts = {
        "shot": of_shot.name,
        "quality": of_shot.quality_name,
        "variant": of_shot.variant,
        "share": part,
        "seed": seed,
        "finished": len(audited.finished),
        "same": is_same,
        "frames": [frame.as_data() for frame in compared],
        "kept": None if is_same else str(audited.home),
    }
    print_result(_report(audited, compared), facts, common.json)
    raise typer.Exit(outcome.exit_code if outcome.exit_code == MachineError.exit_code else int(not is_same))


@dataclass(frozen=True)
class AuditedFrame:
    """A frame that was made again.

    difference  what is different about it, in words; empty where all values of all layers are the same
    """

    number: int
    difference: str

    @property
    def is_same(self) -> bool:
        return not self.difference

    def as_data(self) -> dict[str, object]:
        return {"frame": self.number, "same": self.is_same, "difference": self.difference}


@dataclass(frozen=True)
class Audit:
    """Finished frames of a shot, some of which are made again in a root of their own.

    finished  the keys of finished frames, and of what they are averaged over, by number
    """

    project: Project
    request: RenderRequest
    finished: dict[int, FrameKeys]

    @property
    def home(self) -> Path:
        """The root in which frames are made again."""
        return (
            Folders.of_root(self.project.root).state
            / "audit"
            / f"{self.request.name}.{self.request.quality_name}"
        )

    @property
    def lock(self) -> dict[str, str]:
        """The name of the lock of its root, and in words what it is for."""
        name, quality = self.request.name, self.request.quality_name
        return {Locks.name(f"audit/{name}", quality): f"the audit of {name} at {quality}"}

    def chosen(self, share: float, seed: int) -> list[int]:
        """Return the numbers of a share of the frames, at least one: those of the least hashes."""

        def chance(number: int) -> bytes:
            return hashlib.blake2b(f"{seed} {number} {self.finished[number].frame}".encode()).digest()

        count = max(1, math.ceil(share * len(self.finished) - 1e-9))
        return sorted(sorted(self.finished, key=chance)[:count])

    def plan(self, chosen: Sequence[int]) -> Plan:
        """Return the plan of frames, with the neighbours that the temporal denoiser reads."""
        planner = replace(self.project, root=self.home).planner()
        around = {each for number in chosen for each in self.finished[number].window}
        planner.pictures(replace(self.request, requested=FrameRange(sorted(around))))
        return planner.plan()

    def compared(self, chosen: Sequence[int]) -> list[AuditedFrame]:
        """Compare frames that were made again with those of the store."""
        again, before = Store(self.home, url=None), self.project.store
        frames = []
        for number in chosen:
            name = "frame", self.finished[number].frame
            made = again.is_here(*name)
            words = difference(before.path(*name), again.path(*name)) if made else "was not made again"
            frames.append(AuditedFrame(number, words))
        return frames


def finished_frames(request: RenderRequest, store: Store) -> dict[int, FrameKeys]:
    """Return the keys of the finished frames of a request, fetched where a remote store has them.

    Raises MissingInputError where there are none.
    """
    keys = request.keys.pictures(store)
    numbers = () if keys is None else request.requested
    finished = {
        number: keys[number] for number in numbers if keys and store.bring("frame", keys[number].frame)
    }
    if not finished:
        raise MissingInputError(
            f"{request.name} has no finished frames at {request.quality_name} that fit its shot file; "
            f"flowsculpt render {request.name} -q {request.quality_name} makes them"
        )
    return finished


def difference(before: Path, again: Path) -> str:
    """Return in words how two pictures differ; an empty string where each layer has the same bits."""
    try:
        one, other = read_exr(before)[0].arrays, read_exr(again)[0].arrays
    except RenderError as error:
        return f"cannot be read: {error}"
    if one.keys() != other.keys():
        return f"has other layers: {', '.join(sorted(one.keys() ^ other.keys()))} in one of the two"
    words = []
    for name in sorted(one):
        then, now = np.asarray(one[name]), np.asarray(other[name])
        if then.shape != now.shape:
            words.append(f"{name} has another size")
        elif then.tobytes() != now.tobytes():
            apart = np.abs(np.nan_to_num(then.astype(np.float64)) - np.nan_to_num(now.astype(np.float64)))
            share = float(((then != now) & ~(np.isnan(then) & np.isnan(now))).any(axis=2).mean())
            words.append(f"{name} differs in {share:.2%} of its pixels, by up to {apart.max():.3g}")
    return "; ".join(words)


def _share(text: str) -> float:
    """Read `1%`. Raises UsageError."""
    try:
        part = float(text.strip().removesuffix("%")) / 100.0
    except ValueError:
        part = math.nan
    if not 0.0 < part <= 1.0:
        raise UsageError(f"--share {text}: not a share; write a percentage above 0 and up to 100, such as 1%")
    return part


def _report(audited: Audit, compared: Sequence[AuditedFrame]) -> str:
    lines = [f"frame {each.number}: {each.difference or 'the same bits'}" for each in compared]
    unlike = [each for each in compared if not each.is_same]
    about = f"{audited.request.name} at {audited.request.quality_name}"
    whole = f"{about}: {len(compared)} of {plural(len(audited.finished), 'finished frame')} made again"
    if not unlike:
        return "\n".join([*lines, f"{whole}; all are the same, bit for bit."])
    return "\n".join([*lines, f"{whole}; {len(unlike)} not the same. The new frames are in {audited.home}."])
