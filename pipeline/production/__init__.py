"""The production around a shot: keys, store, plan, the tasks that Snakemake runs, and the run itself."""

from flowsculpt.render.base.python_process import prepare

prepare()
