"""The Snakefile's view of a plan: what each job reads, is called with, and needs.

`flowsculpt` hands over a frozen plan in `config["plan"]`. Plain `snakemake` plans what its targets and
`--config` ask for, compares it with the store, and freezes the plan for the jobs, which may run on other
machines. Snakemake sets its targets after it has parsed the Snakefile, so the plan is made when the first
input function is called.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import stat
import sys
from argparse import ArgumentParser
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flowsculpt.pipeline.errors import FlowsculptError, UsageError, suggest
from flowsculpt.pipeline.frames import FrameRange, FrameSelection
from flowsculpt.pipeline.plugin import plugins
from flowsculpt.pipeline.production.execution.executors import extend_farm_executors
from flowsculpt.pipeline.production.execution.run import with_inputs_here
from flowsculpt.pipeline.production.planning.plan import Job, Plan, check_done_files, movie_record
from flowsculpt.pipeline.production.planning.profile import Share
from flowsculpt.pipeline.production.request.lookup import Show, today_name
from flowsculpt.pipeline.production.stages import PLUGIN_STAGES, STAGES, forced_with
from flowsculpt.pipeline.production.store.history import summarise
from flowsculpt.pipeline.production.store.locks import Locks
from flowsculpt.pipeline.production.store.store import Store
from flowsculpt.pipeline.production.tasks.job import MOST_FAULTS, faults_of_hosts
from flowsculpt.render.base.atomic_write import atomic_write
from flowsculpt.render.base.python_process import command_line, distrust_working_folder
from flowsculpt.render.scene.render_quality import DEFAULT_QUALITY

if TYPE_CHECKING:
    from flowsculpt.pipeline.production.execution.project import Project
    from flowsculpt.pipeline.production.planning.planner import Planner

SETTINGS = ("edit", "shot", "shots", "frames", "quality", "allow_code")
"""Names that `--config` accepts."""

PROFILE_SETTINGS = ("threads", "min_frames", "variant")
"""Names that `config` of a profile accepts."""

DEFAULT_CORES = 2
"""Cores to plan for when a command such as --rulegraph runs nothing and names none."""


JOB_PROCESS = re.sub("[{}]", r"\g<0>\g<0>", command_line("flowsculpt.pipeline.production.tasks.worker"))
"""The program of a job in the shell commands of rules, in which Snakemake fills in `{params}`."""


class PlannedWorkflow:
    """The plan, as the rules of the Snakefile ask for it.

    workflow, config  Snakemake's own

    Ends the process with exit code 1 and one line for what is wrong with `--config` or a target.
    """

    def __init__(self, workflow: Any, config: Mapping[str, Any]) -> None:
        distrust_working_folder()
        extend_farm_executors(self.unfit_hosts)
        self._workflow, self._config, self._root = workflow, config, Path.cwd()
        for name in config:
            if name not in (*SETTINGS, *PROFILE_SETTINGS, "plan"):
                raise SystemExit(f"--config {name}: unknown setting. {suggest(name, SETTINGS)}")

    @cached_property
    def plan(self) -> Plan:
        """The frozen plan, or one that is made now."""
        try:
            if "plan" in self._config:
                plan = Plan.thaw(self._root / str(self._config["plan"]))
            else:
                plan = self._planned()
            if self._workflow.is_main_process:
                check_done_files(plan, Store(self._root))
        except FlowsculptError as error:
            raise SystemExit(str(error)) from None
        return plan

    # What rules ask

    @property
    def targets(self) -> list[str]:
        """The outputs that are asked for."""
        return self.plan.outputs

    def inputs(self, rule: str, wildcards: Any, stage: str) -> list[str]:
        """Return the outputs of the jobs of a stage that a job of a rule reads."""
        return self.plan.inputs(self._job(rule, wildcards), stage)

    def plugin_inputs(self, rule: str, wildcards: Any) -> list[str]:
        """Return the outputs of plug-ins' stages that a job reads, and of `render` if it is one of these."""
        job = self._job(rule, wildcards)
        stages = [
            stage for stage in STAGES[job.stage].reads if STAGES[job.stage].plugin or STAGES[stage].plugin
        ]
        return [output for stage in stages for output in self.plan.inputs(job, stage)]

    def frame_inputs(self, wildcards: Any) -> list[str]:
        """Return the done-file of the job that finishes a frame."""
        plan, number, jobs = self.plan, int(wildcards.number), []
        for place in (place for place, stage in plan.goals if stage == "finish"):
            request = plan.requests[place]
            if (request.name, request.quality_name) == (wildcards.shot, wildcards.quality):
                jobs += [job for job in plan.jobs_of(place, "finish") if number in job.frames]
        return list(dict.fromkeys(job.output for job in jobs))

    def words(self, rule: str, wildcards: Any) -> str:
        """Return what the process of a job is called with."""
        job = self._job(rule, wildcards)
        movie = ["--key", self.movie_key(rule, wildcards)] if job.output.endswith(".mp4") else []
        return shlex.join([str(self.plan.file), job.name, *movie])

    def movie_key(self, rule: str, wildcards: Any) -> str:
        """Return the key by which Snakemake knows a movie: another one makes it encode the movie again.

        A movie that is up to date keeps the key that Snakemake recorded.
        """
        job = self._job(rule, wildcards)
        try:
            known = (self._root / movie_record(job.output)).read_text(encoding="utf-8")
        except (OSError, ValueError):
            return job.key
        if job.present:
            return known
        return job.key if job.key != known else f"{job.key}+"

    def threads(self, rule: str, wildcards: Any) -> int:
        """Return the threads of a job."""
        return self._job(rule, wildcards).threads

    def memory(self, rule: str, wildcards: Any) -> int:
        """Return the MiB that a job needs, by what earlier pictures took."""
        return self.plan.memory_mib(self._job(rule, wildcards))

    def minutes(self, rule: str, wildcards: Any, threads: int, attempt: int) -> int | None:
        """Return the minutes that a job may take, as long as jobs of a farm may; None on this machine."""
        limit = self.plan.minutes(self._job(rule, wildcards), threads)
        return None if limit is None else limit * attempt

    def gpus(self, rule: str, wildcards: Any) -> int | None:
        """Return 1 for a job of a farm that renders with CUDA, else None."""
        return self.plan.gpus(self._job(rule, wildcards))

    def _job(self, rule: str, wildcards: Any) -> Job:
        if rule in ("assemble", "film"):
            home = "film" if rule == "film" else wildcards.shot
            known = f"renders/{home}/{wildcards.quality}/{wildcards.movie}.mp4"
        else:
            known = wildcards.key
        if known not in self._jobs:
            raise SystemExit(f"{known}: no job of this plan makes it; ask for a frame, a movie, or nothing")
        return self._jobs[known]

    @cached_property
    def _jobs(self) -> Mapping[str, Job]:
        """The jobs by key, those of movies by the movie."""
        return {job.output if job.output.endswith(".mp4") else job.key: job for job in self.plan.jobs}

    def unfit_hosts(self, snakemake_job: Any) -> set[str]:
        """Return the hosts that are left out, and those that have failed at a frame of a job."""
        job = self._job(snakemake_job.rule.name, snakemake_job.wildcards)
        request = self.plan.requests[job.requests[0]]
        own = {(request.folders.title, request.quality_name, number) for number in job.frames}
        return {
            host
            for (host, stage), frames in faults_of_hosts(self._root, self.plan).items()
            if len(frames) >= MOST_FAULTS or (stage == job.stage and frames & own)
        }

    # Planning

    def _planned(self) -> Plan:
        """Plan what targets and `--config` ask for, with jobs for what is there already.

        If jobs are to run, hold the locks, restore links and freeze the plan.
        """
        from flowsculpt.pipeline.production.execution.project import Project  # which jobs need not wait for

        workflow, config = self._workflow, self._config
        settings, is_farm = workflow.dag_settings, not workflow.local_exec
        cores = workflow.nodes if is_farm else workflow._cores or DEFAULT_CORES
        settings_of_farm = {**_profile_config(), **config} if is_farm else {}
        project = Project(
            self._root,
            cores,
            settings_of_farm.get("variant"),
            allow_code=_allowed(config.get("allow_code", False)),
            for_farm=is_farm,
        )
        share = Share.of(settings_of_farm) if is_farm else None
        forced = set(STAGES) if settings.forceall else set(STAGES) & set(settings.forcerun)
        if "plug_in" in settings.forcerun:
            forced |= {stage.name for stage in PLUGIN_STAGES}
        if settings.forcetargets:
            forced |= {"assemble", "film"}

        def make_plan() -> Plan:
            planner = replace(project.planner(), side_by_side=cores, cores=cores, share=share)
            self._ask(project, planner, sorted(settings.targets))
            return replace(planner.plan(with_rest=True), force=tuple(sorted(forced_with(forced))))

        plan = make_plan()
        for note in plan.notes:
            print(note, file=sys.stderr)
        if workflow.executor_plugin is not None and not workflow.dryrun:
            _HELD.enter_context(Locks(self._root).hold_with_writers())
            project.store.upload_missed()
            plan, _ = with_inputs_here(plan, make_plan, project.store)
            _HELD.enter_context(Locks(self._root).hold(plan.lock_names))
            plan.restore_links(project.store)
            summarise(self._root)
            for target in filter(_FRAME.fullmatch, settings.targets):
                _unprotect(self._root / target)
            plan = plan.named_last(self._root)
            plan.freeze(self._root)
            arguments = workflow.config_settings
            arguments.config_args = [*(arguments.config_args or ()), f"plan={plan.file}"]
        return plan

    def _ask(self, project: Project, planner: Planner, targets: list[str]) -> None:
        """Ask the planner for what the targets and `--config` name: by default the film of an edit."""
        config, quality = self._config, today_name(str(self._config.get("quality", DEFAULT_QUALITY)))
        frames = FrameSelection.of_text(str(config["frames"])) if "frames" in config else None
        edit = str(config.get("edit", Show().film.stem))
        shots = [name for name in str(config.get("shots", config.get("shot", ""))).split(",") if name]
        numbers: dict[tuple[str, str], list[int]] = {}
        for target in targets:
            if match := _FRAME.fullmatch(target):
                place = _shot_of(match, target), match["quality"]
                numbers.setdefault(place, []).append(int(match["number"]))
            elif match := _FILM.fullmatch(target):
                project.add_film(planner, match["quality"], Show().find_edit(match["movie"]))
            elif match := _MOVIE.fullmatch(target):
                shot = _shot_of(match, target)
                part = FrameRange.parse(match["frames"]) if match["frames"] else None
                project.add_pictures(planner, shot, match["quality"], part)
            elif target == "shots":
                of_film = [] if shots else project.edit(quality, Show().find_edit(edit))[1]
                for request in [
                    project.request(Show().find_shot(name), quality) for name in shots
                ] or of_film:
                    planner.surfaces(request.whole())
        for (shot, wanted), frame_numbers in numbers.items():
            planner.pictures(project.request(Show().find_shot(shot), wanted, FrameRange(frame_numbers)))
        if targets and "all" not in targets:
            return
        for name in shots:
            project.add_pictures(planner, name, quality, frames)
        if frames is not None and not shots:
            raise UsageError(f"--config frames={frames} needs a shot; add shot=NAME.")
        if not shots:
            project.add_film(planner, quality, Show().find_edit(edit))


def _profile_config() -> dict[str, Any]:
    """Return `config` of the last profile that has one; Snakemake drops all of it for one --config."""
    from snakemake.cli import get_profile_dir, parse_config
    from snakemake.profiles import ProfileConfigFileParser

    ours = ArgumentParser(add_help=False, allow_abbrev=False)
    ours.add_argument("--profile", action="append")
    named = ours.parse_known_args(sys.argv[1:])[0].profile or [os.environ.get("SNAKEMAKE_PROFILE", "none")]
    settings: list[str] = []
    for name in named:
        if name != "none":
            _, file = get_profile_dir(name)
            with file.open(encoding="utf-8") as stream:
                settings = ProfileConfigFileParser().parse(stream).get("config", settings)
    return dict(parse_config(settings))


_FRAME = re.compile(
    r"renders/(?P<home>.+)/(?P<quality>[^/]+)/frames/(?P<name>[^/]+)\.(?P<number>-?\d{4,})\.exr"
)
_FILM = re.compile(r"renders/film/(?P<quality>[^/]+)/(?P<movie>[^/]+)\.mp4")
_MOVIE = re.compile(
    r"renders/(?P<home>.+)/(?P<quality>[^/]+)/(?P<name>[^/]+?)(\.(?P<frames>[-\d,x:y]+))?\.mp4"
)


_HELD = ExitStack()
"""The locks this process holds until it ends."""


def _unprotect(path: Path) -> None:
    """Replace a read-only link by a copy: Snakemake refuses to make a write-protected file again."""
    if path.is_file() and not path.stat().st_mode & stat.S_IWUSR:
        with atomic_write(path) as draft:
            shutil.copyfile(path, draft)


def _shot_of(match: re.Match[str], target: str) -> str:
    """Return the shot of a file. Raises UsageError for a file that no shot alone has."""
    kind = match["home"].partition("/")[0]
    if kind in plugins().frame_sources:
        raise UsageError(f"{target}: flowsculpt {kind} {match['name']} makes the pictures in renders/{kind}")
    if match["home"] != match["name"]:
        raise UsageError(f"{target}: files of a shot lie in renders/SHOT and begin with its name")
    return match["name"]


def _allowed(value: Any) -> bool:
    """Read `--config allow_code=true`. Raises UsageError for what is neither true nor false."""
    said = str(value).lower()
    if said not in ("true", "false"):
        raise UsageError(
            f"allow_code is {value!r}; it says whether shots may run their Python files. Write true or false."
        )
    return said == "true"
