"""Do one job: `python -m flowsculpt.pipeline.production.tasks.worker PLAN JOB`, and options.

The pool of workers forks a process for each job, in which `run` does it. Farms and plain `snakemake` start a
process; there rendering happens in its children, for a renderer that crashes takes only itself along.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import traceback
from argparse import ArgumentParser
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path
from subprocess import Popen
from typing import Any

from flowsculpt.pipeline.errors import FlowsculptError, FrameError, MachineError
from flowsculpt.pipeline.frames import FrameRange
from flowsculpt.pipeline.plugin import fault_of_plugin
from flowsculpt.pipeline.production.planning.plan import Plan, write_manifest
from flowsculpt.pipeline.production.planning.profile import VariantError, require_variant
from flowsculpt.pipeline.production.stages import STAGES
from flowsculpt.pipeline.production.store.locks import Locks
from flowsculpt.pipeline.production.store.shared_kernels import fetch_kernels
from flowsculpt.pipeline.production.tasks.job import (
    ENVIRONMENT,
    Context,
    bring_inputs_to_now,
    cpu_of_job,
    report_store_warnings,
    write_done_file,
)
from flowsculpt.pipeline.production.tasks.worker_end import (
    INTERRUPTED,
    RESTART_WORKER,
    MemoryLimitError,
    StoppedError,
    fall_back_to_other_variant,
    report_killed,
    run_children,
    settled_frames,
    verdict,
)
from flowsculpt.render.base import python_process
from flowsculpt.render.base.foreign_code import is_of_user
from flowsculpt.render.base.python_process import ENDING, ForkedProcess, interrupt_once, postpone_collection
from flowsculpt.render.base.root_files import open_file
from flowsculpt.render.mitsuba.engine import GPU_VARIANTS, available_cores


def do_job(
    plan_path: str,
    job_name: str,
    insist: bool = False,
    threads: int | None = None,
    key: str | None = None,
    log: str | None = None,
    after: int | None = None,
) -> int:
    """Do one job; return 0 if all of it went well, 1 if something failed and the event log says what.

    insist   do it again though an earlier attempt has said why it failed
    threads  the threads that Snakemake gave the job, by default those of the plan
    key      the key by which Snakemake knows a movie
    log      the file, relative to the root, for what the job prints
    after    the exit code of the worker that this one takes over from, 0 for the first of a job; where this
             is None, a job that renders is done by children of this process
    """
    root = Path.cwd()
    context = Context.of(root, Plan.thaw(root / plan_path), job_name)
    if log:
        keep_or_clear = os.O_APPEND if after else os.O_TRUNC
        os.dup2(open_file(root / log, os.O_WRONLY | os.O_CREAT | keep_or_clear), 1)
        os.dup2(1, 2)
    job = context.job
    context = replace(context, job=replace(job, threads=threads or job.threads, key=key or job.key))
    if after is None and job.stage == "render":
        return run_children(lambda code: _child(context, plan_path, insist, code))
    return _heeding_signals(context, lambda: _do(context, insist, after or 0))


def _child(context: Context, plan_path: str, insist: bool, after: int) -> ForkedProcess | Popen[bytes]:
    """Start a worker for a job: a fork of this process, or where that is not sound, a new one."""
    if ForkedProcess.may_start():
        work = partial(_heeding_signals, context, lambda: _do(context, insist, after))
        return ForkedProcess(lambda: _exit_code(work))
    job = context.job
    words = [plan_path, job.name, "--threads", str(job.threads), "--after", str(after)]
    command = python_process.python_command(__spec__.name, *words, *(["--insist"] if insist else []))
    return Popen(command, env=python_process.environment(), stdin=subprocess.DEVNULL)


def _heeding_signals(context: Context, work: Callable[[], int]) -> int:
    """Work on a job, which a signal interrupts; return the exit code: 1 if the log says what failed."""
    for number in ENDING:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, interrupt_once)
    try:
        report_store_warnings(context)
        return work()
    except (FlowsculptError, OSError) as error:
        context.fail(_as_failure(error, context.root))
        context.end()
        return 1


def _do(context: Context, insist: bool, after: int) -> int:
    """Do the job of a context, or what is left of it; the other arguments are those of `do_job`."""
    root, job = context.root, context.job
    if after < 0:
        report_killed(context, signal.Signals(-after))
        return 1
    is_first = not (insist or after)
    if is_first and context.failures.is_final():
        return 1
    context.begin(after)
    if is_first and (reason := context.failures.reason_to_leave()):
        context.refuse(MachineError(reason))
        return ENVIRONMENT
    with Locks(root).hold_with_writers(wait=True), ExitStack() as stack:
        if not STAGES[job.stage].per_quality:
            stack.enter_context(Locks(root).hold_key(job.key, context.waits))
        bring_inputs_to_now(context)
        return _render(context, after) if job.stage == "render" else _finish(context, context)


def _render(context: Context, after: int) -> int:
    """Render the frames of a job that the workers before this one have left."""
    if fault := _unfit(context):
        return fault
    job = context.job
    left = replace(job, frames=FrameRange(job.frames[settled_frames(context) if after else 0 :]))
    code = verdict(context, _finish(replace(context, job=left), context))
    if code == 0 and job.output and not (context.root / job.output).exists():
        write_manifest(context.root / job.output, "raw", ())  # some frames failed, others go on
    return code


def _finish(context: Context, whole: Context) -> int:
    """Do a job, or the rest of one, in this process; write the done-file of the whole job."""
    code = work(context)
    if code == 0:
        write_done_file(whole)
    return code


def _unfit(context: Context) -> int:
    """Return 0 where this machine renders with the plan's variant; else report what it lacks and return 4."""
    try:
        require_variant(context.request.variant)
    except VariantError as error:
        context.refuse(error)
        return error.exit_code
    return 0


def work(context: Context) -> int:
    """Do one job in this process; return 0 if all went well, 1 if the event log says what failed.

    Return RESTART_WORKER if a fresh process is to render the rest.
    """
    job = context.job
    _limit_kernels(job.threads)
    well = False
    try:
        _bring_kernels(context)
        well = task_of(job.stage)(context)
    except MemoryLimitError as restart:
        message = f"the renderer grew to {restart.held:.0f} MiB; a new one continues"
        sizes = {"held_mib": restart.held, "most_mib": restart.limit}
        context.write("renewed", number=None, message=message, cpu=cpu_of_job(), **sizes)
        return RESTART_WORKER
    except FlowsculptError as error:
        context.fail(error)
    except BaseException as error:  # a stranger's function may raise anything
        if is_of_user(error) or isinstance(error, StoppedError):
            raise
        with suppress(OSError):  # the job's log may lie on a full disk
            traceback.print_exc()
        on_gpu = job.stage == "render" and context.request.variant in GPU_VARIANTS
        if on_gpu and fall_back_to_other_variant(context, f"failed ({str(error).partition(chr(10))[0]})"):
            return 1  # its memory may be too small, its driver too old: nothing that another frame would mend
        if isinstance(error, OSError):
            context.fail(_as_failure(error, context.root))
        else:
            bug = FrameError(f"{job.name}: {type(error).__name__}: {error}; this is a bug in flowsculpt")
            context.fail(fault_of_plugin(error) or bug)
    context.end()
    return 0 if well else 1


def _bring_kernels(context: Context) -> None:
    """Fetch the compiled kernels that the plan names, where this machine lacks them and there is a store."""
    planned, remote = context.plan.kernels, context.store.remote
    if planned and remote is not None:
        with suppress(MachineError):  # compiling them needs no disk
            fetch_kernels(remote, planned)


def _as_failure(error: FlowsculptError | OSError, root: Path) -> FlowsculptError:
    return (
        error
        if isinstance(error, FlowsculptError)
        else MachineError.of_path(Path(error.filename or root), error)
    )


def task_of(stage: str) -> Callable[[Context], bool]:
    """Return the function that does the jobs of a stage; it returns True if all went well."""
    row = STAGES[stage]
    return getattr(import_module(f"flowsculpt.pipeline.production.tasks.{row.module}"), row.function or stage)


def _limit_kernels(threads: int) -> None:
    """Limit the threads of kernels to those of the job.

    A kernel on more threads waits for them, busily, while other jobs have the cores. numba looks at the
    environment when it is first imported, which many jobs never do.
    """
    if "numba" not in sys.modules:
        os.environ["NUMBA_NUM_THREADS"] = str(min(threads, available_cores()))
        return
    import numba

    numba.set_num_threads(min(threads, numba.config.NUMBA_NUM_THREADS))


def run(words: Sequence[str]) -> int:
    """Do the job that the words of a command line name; return the exit code."""
    return _exit_code(lambda: do_job(**_arguments(words)))


def _exit_code(work: Callable[[], int]) -> int:
    """Return the exit code of work on a job: 130 if a signal ended it, 4 if the machine refused it."""
    try:
        return work()
    except KeyboardInterrupt:
        return INTERRUPTED
    except (OSError, MachineError) as error:
        with suppress(OSError):
            print(_as_failure(error, Path.cwd()), file=sys.stderr)
        return ENVIRONMENT


def _arguments(words: Sequence[str]) -> dict[str, Any]:
    parser = ArgumentParser(prog="python -m flowsculpt.pipeline.production.tasks.worker")
    parser.add_argument("plan_path")
    parser.add_argument("job_name")
    parser.add_argument("--threads", type=int)
    parser.add_argument("--key")
    parser.add_argument("--log")
    parser.add_argument("--after", type=int)
    parser.add_argument("--insist", action="store_true")
    return vars(parser.parse_args(words))


if __name__ == "__main__":
    postpone_collection()
    sys.exit(run(sys.argv[1:]))
