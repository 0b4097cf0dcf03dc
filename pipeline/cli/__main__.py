"""`python -m pipeline.cli` is `flowsculpt`."""

from pipeline.cli.app import main

main()
