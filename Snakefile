"""The workflow: rules for the tasks of a plan, and a job for each of the plan's jobs.

`flowsculpt` hands over a frozen plan in `config["plan"]`. Called directly, `snakemake --cores 2` plans the
film itself; `--config shot=A020_lorenz frames=10-20x2 quality=preview` plans frames of one shot,
`--config edit=showreel` the film of another edit.
A job's output is the mark that it is done: what it makes is known by key, so that Snakemake need not look
after every frame. Each run's plan has its own name, and so its own marks: a job stands in a plan because it
must run.
"""

import sys

from pipeline.errors import FlowsculptError
from pipeline.production.execution.snakefile import plan_of
from snakemake.exceptions import WorkflowError

try:
    plan, plan_file, logs = plan_of(
        config, cores=workflow.nodes or workflow.cores, main=workflow.is_main_process
    )
except FlowsculptError as error:
    raise WorkflowError(error) from None

jobs = {job.name: job for job in plan.jobs}


def mark(job):
    return plan.mark(job).as_posix()


def marks_before(wildcards):
    return [mark(jobs[name]) for name in jobs[wildcards.job].after]


def threads_of(wildcards):
    return jobs[wildcards.job].threads


def memory_of(wildcards, attempt):
    return jobs[wildcards.job].needs.mib * attempt


def minutes_of(wildcards, attempt):
    return jobs[wildcards.job].needs.minutes * attempt


def resources_of(rule):
    timed = all(job.needs.minutes for job in plan.jobs if job.rule == rule)
    return {"mem_mb": memory_of, **({"runtime": minutes_of} if timed else {})}


rule all:
    default_target: True
    input:
        [mark(job) for job in plan.last_jobs] or plan_file,


for each in {job.rule: job for job in plan.jobs}.values():

    rule:
        name:
            each.rule
        input:
            marks_before,
        output:
            touch((plan.mark(each).parent / "{job}").as_posix()),
        log:
            f"{logs}/{{job}}.log",
        priority: each.urgency
        localrule: each.stays
        threads: threads_of
        resources:
            **resources_of(each.rule),
        params:
            plan=plan_file,
            python=sys.executable,
        shell:
            "{params.python:q} -m pipeline.production.tasks {params.plan:q} {wildcards.job:q} >{log:q} 2>&1"
