"""The process of one job: `python -m pipeline.production.tasks PLAN JOB`, and options.

Rendering happens in children: a renderer that crashes takes only itself along. What a job needs is imported
by the process that does it alone, so that who watches is there at once.
"""

from __future__ import annotations

import signal
import sys
from argparse import ArgumentParser
from contextlib import ExitStack
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

from pipeline.production.planning.plan import Plan, write_manifest
from pipeline.production.stages import STAGES
from pipeline.production.store.locks import of_key, writing
from pipeline.production.tasks.job import Context
from pipeline.production.tasks.supervisor import Supervisor, renderer


def main(
    plan_path: str,
    job_name: str,
    settled: int | None = None,
    insist: bool = False,
    threads: int | None = None,
    key: str | None = None,
) -> int:
    """Do one job; return 0 if all of it went well, 1 if something failed and the event log says what.

    settled  for a process that renders: how many of the job's frames others before it have made, or failed
             at; None has such processes started. One that has grown returns RESTART_WORKER
    insist   do it again though an earlier attempt has said why it failed
    threads  the threads that Snakemake gave the job, by default those of the plan
    key      the key by which Snakemake knows a movie
    """
    root = Path.cwd()
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # what a farm sends first
    context = Context.of(root, Plan.thaw(root / plan_path), job_name)
    job = context.job
    context = whole = replace(context, job=replace(job, threads=threads or job.threads, key=key or job.key))
    if settled is not None:
        context.begin()
        context = replace(context, job=replace(context.job, frames=context.job.frames[settled:]))
        return _work(context, whole)
    if not insist and context.failed_for_good():
        return 1
    context.begin()
    with writing(root, wait=True), ExitStack() as stack:
        if not STAGES[job.stage].per_quality:
            stack.enter_context(of_key(root, job.key, context.waits))
        context.bring_inputs_to_now()
        if job.stage != "render":
            return _work(context, whole)
        code = Supervisor(context, renderer(plan_path, context.job)).run()
        if code == 0 and job.output and not (root / job.output).exists():
            write_manifest(root / job.output, "raw", ())  # some frames failed, others go on
        return code


def _work(context: Context, whole: Context) -> int:
    """Do a job, or the rest of one, in this process; write the done-file of the whole job."""
    code = int(import_module("pipeline.production.tasks.worker").work(context))
    if code == 0:
        whole.write_done_file()
    return code


def _words() -> dict[str, Any]:
    parser = ArgumentParser(prog="python -m pipeline.production.tasks")
    parser.add_argument("plan_path")
    parser.add_argument("job_name")
    parser.add_argument("--threads", type=int)
    parser.add_argument("--key")
    parser.add_argument("--child", type=int, dest="settled")
    return vars(parser.parse_args())


if __name__ == "__main__":
    try:
        sys.exit(main(**_words()))
    except KeyboardInterrupt:
        sys.exit(130)
