"""`python -m pipeline.cli` is `flowsculpt`."""

from render.base.python_process import distrust_working_folder, postpone_collection

distrust_working_folder()  # which Python has put first, before anything else is imported
postpone_collection()

from pipeline.cli.app import main  # noqa: E402
from pipeline.cli.standard_streams import prepare_streams  # noqa: E402

prepare_streams()
main()
