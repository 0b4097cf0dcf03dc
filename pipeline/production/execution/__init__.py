"""Run plans: Snakemake, retries, the watchdog, farms."""
