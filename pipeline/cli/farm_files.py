"""Write what a farm is given: a plan, a job template of Open Job Description, or manifests of Kubernetes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TextIO

from ruamel.yaml import YAML

from pipeline.cli.options import Common
from pipeline.cli.output import print_result
from pipeline.errors import UsageError
from pipeline.frames import FrameRange
from pipeline.production.execution import kubernetes, openjd
from pipeline.production.planning.plan import Plan
from pipeline.production.planning.profile import Share
from pipeline.production.store.remote_url import store_url
from render.base.atomic_write import atomic_write, disk_errors

FOR_FARMS = ("openjd", "kubernetes", "plan")
"""Formats for farms."""

ENDINGS = {"plan": (".json",), "openjd": (".yaml", ".yml", ".json")}
"""Endings of the file of a format. Kubernetes gets a folder."""

DEFAULTS = {"plan": "plan.json", "openjd": "template.yaml", "kubernetes": "kubernetes"}
"""The file or folder of a format where none is named."""


@dataclass(frozen=True)
class FarmFiles:
    """Files for a farm: their format, where they go, and the container image of pods."""

    form: str
    output: Path
    image: str | None = None

    @classmethod
    def named(cls, form: str, output: Path | None, image: str | None) -> FarmFiles:
        """Return the files of a format. Raises UsageError for another ending, or pods without an image."""
        if form == "kubernetes" and not image:
            raise UsageError("export kubernetes needs the container image of its pods: --image NAME")
        output = output or Path(DEFAULTS[form])
        endings = ENDINGS.get(form)
        if endings is not None and output.suffix not in endings:
            what = "a plan" if form == "plan" else "a template"
            known = " or ".join(endings)
            raise UsageError(f"{output}: {what}'s name ends in {known}; call it {output.stem}{endings[0]}")
        return cls(form, output, image)

    def write(self, common: Common, plan: Plan, name: str) -> None:
        """Write a whole plan in the format, and report the files; `name` is the job's."""
        share = common.profile.exported_share
        if self.form == "plan":
            self._plan(common, plan)
        elif self.form == "openjd":
            self._template(common, plan, name, share)
        else:
            self._manifests(common, plan, share)

    def _plan(self, common: Common, plan: Plan) -> None:
        if not common.dry_run:
            self._make_folders(common)
            plan.write(self.output)
        tasks: dict[str, set[int]] = {}
        shots = {request.name for request in plan.requests}
        for job in plan.jobs:
            alone = len(shots) == 1 or job.stage == "film"
            shot = "" if alone else f"{plan.requests[job.requests[0]].name}/"
            tasks.setdefault(shot + job.stage, set()).update(job.frames)
        frames = {task: sorted(numbers) for task, numbers in tasks.items()}
        words = ", ".join(f"{task}:{FrameRange.of(numbers)}" for task, numbers in frames.items())
        facts = {"plan": str(self.output), "tasks": frames, "targets": list(plan.targets)}
        print_result(f"{self.output}: {common.done('written')}. Tasks: {words}.", facts, common.json)

    def _template(self, common: Common, plan: Plan, name: str, share: Share) -> None:
        beside = self.output.with_name(f"{self.output.name}.plan.json")
        made = openjd.template(plan, beside.name, common.root, name, share.threads, store_url())
        if not common.dry_run:
            self._make_folders(common)
            plan.write(beside)
            _write(self.output, partial(_yaml().dump, made))
        facts = {"template": str(self.output), "plan": str(beside), "targets": list(plan.targets)}
        print_result(f"{self.output}, {beside}: {common.done('written')}.", facts, common.json)

    def _manifests(self, common: Common, plan: Plan, share: Share) -> None:
        jobs = common.profile.jobs
        job = kubernetes.KubernetesJob(plan, str(self.image), store_url(), share.threads, jobs)
        made, script = job.manifests(), job.script()
        if not common.dry_run:
            with disk_errors(self.output):
                self.output.mkdir(parents=True, exist_ok=True)
            for name, objects in made.items():
                _write(self.output / name, partial(_yaml().dump_all, objects))
            _write(self.output / kubernetes.SCRIPT, lambda file: file.write(script))
        names = [*made, kubernetes.SCRIPT]
        facts: dict[str, Any] = {"folder": str(self.output), "files": names, "targets": list(plan.targets)}
        print_result(f"{self.output}: {', '.join(names)} {common.done('written')}.", facts, common.json)

    def _make_folders(self, common: Common) -> None:
        with disk_errors(self.output):
            self.output.parent.mkdir(parents=True, exist_ok=True)
            common.root.mkdir(parents=True, exist_ok=True)  # a worker that does not see it says so


def _write(path: Path, write: Callable[[TextIO], object]) -> None:
    """Write a text file, which appears whole or not at all."""
    with disk_errors(path), atomic_write(path) as draft, draft.open("w", encoding="utf-8") as file:
        write(file)


def _yaml() -> YAML:
    yaml = YAML()
    yaml.width = 100
    return yaml
