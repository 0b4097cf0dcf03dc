"""A working folder with a tiny shot, for tests of its versions: jobs are done one by one in this process."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from flowsculpt.pipeline.frames import FrameRange
from flowsculpt.pipeline.plugins.versions.provenance import FILE, Provenance
from flowsculpt.pipeline.plugins.versions.publishing import Release
from flowsculpt.pipeline.plugins.versions.reproduction import Reproduction
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.planning.plan import Plan
from flowsculpt.pipeline.production.tasks.job import Context
from flowsculpt.pipeline.production.tasks.worker import task_of
from tests.conftest import commanded

NAME = "T010_tiny"
QUALITY = "draft.scale10"
SHOT = """\
title: A wedge, twisted
frames: 1-4
subject: {model: ../models/wedge.obj}
resample: {max_edge_length: 0.9}
flows:
  - twist: {axis: y, amount: {ease: linear, keys: {1: 0, 4: 40}}}
quality: {draft: {samples: 2, auxiliary_samples: 2, denoise: fast, temporal_denoise: 1}}
"""
MODEL = "v 0 0 0\nv 2 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
RENDER = f"flowsculpt render {NAME} -q draft --scale 10%"


@dataclass(frozen=True)
class Desk:
    """A working folder, whose jobs are done one by one in this process."""

    root: Path

    @property
    def shot(self) -> Path:
        return self.root / "shots" / f"{NAME}.yaml"

    @property
    def home(self) -> Path:
        return self.root / "renders" / "published" / NAME

    def release(self, note: str = "", version: str | None = None) -> Release:
        project = Project(self.root, 1)
        return Release(project.request(self.shot, QUALITY), project.store, RENDER, note, version)

    def render(self) -> None:
        done(self.root, Project(self.root, 1).pictures([NAME], QUALITY))

    def repetition(self, frames: str | None = None, **others: str) -> Reproduction:
        source, project = self.home / "v001" / FILE, Project(self.root, 1, **others)
        numbers = None if frames is None else FrameRange.parse(frames)
        return Reproduction(Provenance.read(source), source, project, numbers)

    def command(self, *words: str) -> tuple[int, str]:
        """Exit code and words of a command."""
        return commanded(self.root, *words)


def done(root: Path, plan: Plan) -> None:
    for job in plan.jobs:
        assert task_of(job.stage)(Context.of(root, plan, job.name))


def rewritten(path: Path, content: bytes) -> None:
    """Write a file anew in its place: tests work on links, whose bytes others share."""
    path.unlink()
    path.write_bytes(content)
