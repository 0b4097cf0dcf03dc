"""`python -m pipeline.cli` is `flowsculpt`."""

from pipeline.cli.app import main
from pipeline.cli.standard_streams import prepare_streams

prepare_streams()
main()
