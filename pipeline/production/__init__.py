"""The production around a shot: keys, the store, the plan, the tasks that Snakemake runs, and the run itself."""
