"""The tasks: the functions that the rules of the Snakefile run, one a stage.

`python -m flowsculpt.pipeline.production.tasks.worker PLAN JOB`, in the root, does one job of a frozen plan.
Every task takes its inputs from the store by key, puts its results there by key, and shows them as links
where Snakemake expects them. What the store has already is only linked, so a killed run loses at most the
frame it was at.
"""
