"""A show with a shot whose meshes and cameras are made, and nothing else."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.planning.plan import Plan
from flowsculpt.pipeline.production.request.render_request import RenderRequest
from tests.conftest import commanded, done

NAME = "T010_tiny"
LAST = 24
TITLE = "A box </script><script>window.attacked = 1</script><img src=x onerror='window.attacked = 1'>"
"""A title that attacks pages which show it."""

SHOT = f"""\
title: "{TITLE}"
frames: 1-{LAST}
subject: {{solid: box, size: [2, 2, 2]}}
resample: {{max_edge_length: 0.5}}
flows:
  - twist: {{axis: y, amount: {{ease: linear, keys: {{1: 0, 16: 36, {LAST}: 60}}}}}}
quality: {{daily: {{temporal_denoise: 0}}}}
"""


@dataclass(frozen=True)
class Desk:
    root: Path

    def project(self) -> Project:
        return Project(self.root, 2)

    def request(self, quality: str) -> RenderRequest:
        return self.project().request(self.root / "shots" / f"{NAME}.yaml", quality)

    def command(self, *words: str) -> tuple[int, str]:
        return commanded(self.root, *words)

    def page(self, name: str = NAME) -> Path:
        return self.root / "renders" / "review" / name / "index.html"


def surfaces(project: Project, request: RenderRequest) -> Plan:
    """Plan what pictures are made from: meshes, normals and cameras."""
    planner = project.planner()
    planner.surfaces(request)
    return planner.plan()


def simulated(root: Path, shot: str = SHOT) -> Desk:
    """A studio with a shot, its meshes and its cameras."""
    (root / "shots").mkdir(parents=True, exist_ok=True)
    (root / "shots" / f"{NAME}.yaml").write_text(shot)
    desk = Desk(root)
    done(root, surfaces(desk.project(), desk.request("draft")))
    return desk
