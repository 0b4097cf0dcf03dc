"""The workflow: a rule for each task of a plan, and a job for each of the plan's jobs.

`flowsculpt` hands over a frozen plan in `config["plan"]`. Called directly, `snakemake --cores 2` plans the
film itself; `--config shot=A020_lorenz frames=10-20x2 quality=preview` plans frames of one shot,
`--config edit=showreel` the film of another edit.
A job's output is the mark that it is done: what it makes is known by key, so that Snakemake need not look
after every frame. Each run's plan has its own name, and so its own marks: a job stands in a plan because it
must run.
"""

import sys

from pipeline.errors import FlowsculptError
from pipeline.production.layout import MARKS
from pipeline.production.plan import FARMED
from pipeline.production.snakefile import plan_of
from snakemake.exceptions import WorkflowError

try:
    plan, plan_file, logs = plan_of(
        config, cores=workflow.nodes or workflow.cores, main=workflow.is_main_process
    )
except FlowsculptError as error:
    raise WorkflowError(error) from None

jobs = {job.name: job for job in plan.jobs}
marks = f"{MARKS.as_posix()}/{plan.name}"


def mark(job):
    return plan.mark(job).as_posix()


def marks_needed(wildcards):
    return [mark(jobs[name]) for name in jobs[wildcards.job].after]


def threads_of(wildcards):
    return jobs[wildcards.job].threads


def memory_of(wildcards, attempt):
    return jobs[wildcards.job].needs.mib * attempt


def minutes_of(wildcards, attempt):
    return jobs[wildcards.job].needs.minutes * attempt


def resources_of(task):
    timed = all(job.needs.minutes for job in plan.jobs if job.task == task)
    return {"mem_mb": memory_of, **({"runtime": minutes_of} if timed else {})}


rule all:
    default_target: True
    input:
        [mark(job) for job in plan.last_jobs],


for task, urgency in {job.task: job.urgency for job in plan.jobs}.items():

    rule:
        name:
            task
        input:
            marks_needed,
        output:
            touch(f"{marks}/{task}/{{job}}"),
        log:
            f"{logs}/{{job}}.log",
        priority: urgency
        localrule: task not in FARMED
        threads: threads_of
        resources:
            **resources_of(task),
        params:
            plan=plan_file,
            python=sys.executable,
        shell:
            "{params.python:q} -m pipeline.production.tasks {params.plan:q} {wildcards.job:q} >{log:q} 2>&1"
