"""The workflow: one rule for each job of a plan.

`flowsculpt` hands over a frozen plan in `config["plan"]`. Called directly, `snakemake --cores 2` plans the
film itself; `--config shot=A020_lorenz frames=10-20x2 quality=preview` plans frames of one shot,
`--config edit=showreel` the film of another edit.
Parameters, not file times, decide what is stale, and each run's plan has its own name: a job stands
in a plan because it must run.
"""

import sys

from pipeline.errors import FlowsculptError
from pipeline.production.snakefile import plan_of
from snakemake.exceptions import WorkflowError

try:
    plan, plan_file, logs = plan_of(
        config, cores=workflow.nodes or workflow.cores, main=workflow.is_main_process
    )
except FlowsculptError as error:
    raise WorkflowError(error) from None


rule all:
    default_target: True
    input:
        plan.targets,


for job in plan.jobs:

    rule:
        name:
            job.name
        input:
            job.inputs,
        output:
            job.outputs,
        log:
            f"{logs}/{job.name}.log",
        priority: job.urgency
        localrule: job.stays
        threads: job.threads
        resources:
            **job.needs.resources(),
        params:
            job=job.name,
            plan=plan_file,
            python=sys.executable,
        shell:
            "{params.python:q} -m pipeline.production.tasks {params.plan:q} {params.job:q} >{log:q} 2>&1"
