"""`python -m pipeline.cli` is `flowsculpt`."""

from pipeline.cli.main import main

main()
