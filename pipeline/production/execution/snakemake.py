"""Snakemake, in a process of its own: the Snakefile, a frozen plan, a profile that says where its jobs run.

A process of its own can be ended with all of its jobs, prints where it likes, and leaves our signal handlers
alone. It is forked from this one where that is sound. Elsewhere it is started as `python -m
flowsculpt.pipeline.production.execution.snakemake WORDS…` in the root: Snakemake's own command line, so that
a profile means here what it means to Snakemake.
"""

from __future__ import annotations

import contextlib
import getpass
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from subprocess import Popen
from tempfile import TemporaryFile, gettempdir

import psutil

from flowsculpt.pipeline.errors import MachineError, UsageError
from flowsculpt.pipeline.production.planning.plan import Plan
from flowsculpt.pipeline.production.planning.profile import Profile, shipped
from flowsculpt.pipeline.production.stages import STILLS
from flowsculpt.pipeline.production.store.paths import LOGS, STATE
from flowsculpt.pipeline.production.tasks.worker_pool import WorkerPool
from flowsculpt.render.base import python_process
from flowsculpt.render.base.atomic_write import disk_errors
from flowsculpt.render.base.python_process import ForkedProcess
from flowsculpt.render.base.render_errors import PROBE, REMEDIES
from flowsculpt.render.base.root_files import forbid_links, guard, held, open_file, require_own_folders
from flowsculpt.render.base.user_cache import user_number

RULES = {stage.name: "stills" for stage in STILLS}
"""The rule of each stage that does not have the name of its rule."""

MOTION = ("simulate", "smooth_normals", "frame_camera")

MOST_MOTION = 500
"""Mesh frames, of all shots of a plan, that are simulated before the first frame is rendered."""

PATIENCE = 5.0
"""Seconds that processes have to end before they are killed."""

DEPLOYMENTS = ".snakemake/pip-deployments"
"""A folder in the root from which Snakemake imports packages, among them every plugin for itself."""

FARM_PATIENCE = 90.0
"""Seconds that taking jobs back from a farm may take."""


def snakefile() -> Path:
    """The checkout's Snakefile, or the one shipped in the wheel."""
    here = Path(__file__).parents
    for place in (here[3] / "Snakefile", here[1] / "Snakefile"):
        if place.is_file():
            return place
    raise MachineError("no Snakefile beside the package; install flowsculpt again")


def log_of(plan: Plan) -> Path:
    """Return the file, relative to the root, for what Snakemake prints while it runs a plan."""
    return LOGS / plan.name / "snakemake.log"


def complaint(log: Path) -> str | None:
    """Return the first message about a job that could not be run, such as that a farm refused it."""
    message = re.search(
        r"^ +message: (?!None)(.+?)(?:For further error details.*)?$", _said(log), re.MULTILINE
    )
    return message.group(1).strip().rstrip(".") + "." if message else None


def refusal(root: Path, log: Path) -> str | None:
    """Return why Snakemake could not write what it needs itself: by its log, or as a disk is full."""
    if refused := re.search(rf"^(?:\w+\.)*{MachineError.__name__}: (.+)$", _said(log), re.MULTILINE):
        return refused[1]
    for number, path in re.findall(r"Error: \[Errno (\d+)\] [^\n:]+: '([^'\n]+)'", _said(log)):
        if int(number) in REMEDIES:
            return str(MachineError.of_path(root / path, OSError(int(number), "")))
    for folder in (root / STATE, Path(gettempdir())):
        try:
            require_own_folders(root)
            with disk_errors(folder), held(folder) as place, TemporaryFile(dir=place) as file:
                file.write(bytes(PROBE))
        except MachineError as error:
            return str(error)
    return None


def _said(log: Path) -> str:
    return log.read_text(errors="replace", encoding="utf-8") if log.exists() else ""


@contextmanager
def running(plan: Plan, root: Path, cores: int, profile: Profile) -> Iterator[ForkedProcess | Popen[bytes]]:
    """Have Snakemake run a frozen plan (relative to `root`) on this machine's cores or a farm; yield its
    process, whose exit code is 0 where every job ended well.

    An interrupt ends all jobs, and takes those of a farm back, before it is passed on.
    """
    if not profile.is_local:
        _require_root_for_farm(root)
    log = root / log_of(plan)
    with disk_errors(log):
        output = open_file(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    try:
        process = _start(root, output, _words(plan, cores, profile), profile.is_local)
    finally:
        os.close(output)
    try:
        yield process
    except BaseException:
        if isinstance(process, Popen) and not profile.is_local:
            _take_back(process)
        end_family(process.pid)
        raise
    finally:
        process.wait()


def _start(root: Path, output: int, words: list[str], is_local: bool) -> ForkedProcess | Popen[bytes]:
    """Start Snakemake: where that is sound, by a fork, for much of what it needs is loaded here."""
    if is_local and ForkedProcess.may_start():
        return ForkedProcess(lambda: main(words), output, root)
    return Popen(
        python_process.python_command("flowsculpt.pipeline.production.execution.snakemake", *words),
        cwd=root,
        env=python_process.environment(),
        stdin=subprocess.DEVNULL,
        stdout=output,
        stderr=output,
        start_new_session=not is_local,  # Ctrl-C would cut short what takes jobs back
    )


def _require_root_for_farm(root: Path) -> None:
    """Raise UsageError for a root in which Snakemake's jobs on nodes would run what nobody asked for."""
    if (root / DEPLOYMENTS).exists():
        raise UsageError(
            f"{root / DEPLOYMENTS}: on the nodes of a farm, Snakemake would import packages from here; a "
            "show must not bring code along: remove the folder"
        )
    if wrong := re.search(r"""["'$`\\\n]""", str(root)):
        raise UsageError(
            f"{root}: Snakemake does not quote {wrong[0]!r} in commands for a farm; rename the folder, or "
            "name another by --root"
        )


def _words(plan: Plan, cores: int, profile: Profile) -> list[str]:
    """Return Snakemake's arguments. They win over our own settings, and these over the profile."""
    ours = ["--snakefile", str(snakefile()), "--workflow-profile", str(shipped() / "default")]
    here = ["--local-cores", str(cores)]
    if profile.is_local:
        here = ["--cores", str(cores), "--resources", f"mem_mb={psutil.virtual_memory().available >> 20}"]
    force = ["plug_in" if "." in stage else RULES.get(stage, stage) for stage in sorted(plan.force)]
    forced = ["--forcerun", *dict.fromkeys(force)] if force else []
    soonest = _soonest(plan) if profile.is_local else []
    first = ["--prioritize", *soonest] if soonest else []
    return [*ours, *profile.arguments, *here, *forced, *first, "--config", f"plan={plan.file}"]


def _soonest(plan: Plan) -> list[str]:
    """Return the outputs that people see first: some finished frames, and what an animatic is drawn from.

    These are all meshes and cameras, unless the first frame had to wait long for them. No core is idle.
    """
    finished = [job for job in plan.jobs if job.stage == "finish"]
    motion = [job for job in plan.jobs if job.stage in MOTION]
    frames = sum(len(job.frames) for job in motion if job.stage == "simulate")
    jobs = [*finished[:1], *(motion if frames <= MOST_MOTION else ())]
    return [job.output for job in jobs if job.output]


def _take_back(process: Popen[bytes]) -> None:
    """Have Snakemake cancel what it gave to a farm, as it does when it is interrupted, and wait for it."""
    process.send_signal(signal.SIGINT)
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(FARM_PATIENCE)


def end_family(pid: int) -> None:
    """End a process, if it is still there, and all that it started: asked first, then killed."""
    with contextlib.suppress(psutil.Error, OSError):
        parent = psutil.Process(pid)
        family = [*parent.children(recursive=True), parent]
        for member in family:
            with contextlib.suppress(psutil.Error):
                member.terminate()
        _, stubborn = psutil.wait_procs(family, timeout=PATIENCE)
        for member in stubborn:
            with contextlib.suppress(psutil.Error):
                member.kill()


def _leave_with(parent: int, of_farm: bool) -> None:
    """End this process and its jobs once the process that started it is gone, however it went."""
    while os.getppid() == parent:
        time.sleep(0.5)
    if of_farm:
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(FARM_PATIENCE)
    end_family(os.getpid())


def main(words: list[str]) -> None:
    """Snakemake's command line, which ends this process.

    The lock is ours, not Snakemake's, whose lock outlives a killed process. Times decide nothing: keys in the
    plan do, and a plan holds only jobs that are needed.
    """
    signal.signal(signal.SIGINT, signal.default_int_handler)  # even where the parent process ignores it
    _require_user_name()
    is_local = "--cores" in words
    pool = WorkerPool() if is_local and sys.platform == "linux" else None  # before any thread is started
    watcher = threading.Thread(target=_leave_with, args=(os.getppid(), not is_local), daemon=True)
    watcher.start()
    sys.path_importer_cache[DEPLOYMENTS] = None  # Snakemake puts the folder into the search path
    from snakemake.cli import args_to_api, parse_args  # while the pool loads
    from snakemake.exceptions import print_exception

    from flowsculpt.pipeline.production.execution.executors import register

    python_process.distrust_working_folder()
    guard(Path.cwd())
    forbid_links()
    well = False
    try:
        parser, settings = parse_args(words if pool is None else [*words, "--executor", register(pool)])
        if is_local:
            settings.max_jobs_per_timespan = None  # a limit wakes Snakemake every second, and once it is done
        well = args_to_api(settings, parser)
    except Exception as error:
        print_exception(error)
    finally:
        if pool is not None:
            pool.close()
    sys.exit(0 if well else 1)


def _require_user_name() -> None:
    """Give a user without a name one, as those of containers are: Snakemake ends where there is none."""
    try:
        getpass.getuser()
    except (KeyError, OSError):
        os.environ["LOGNAME"] = str(user_number())


if __name__ == "__main__":
    main(sys.argv[1:])
