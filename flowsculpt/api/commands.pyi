"""What commands print, and the project in which they look up shots and run plans."""

from flowsculpt.pipeline.cli.app import click_commands as click_commands
from flowsculpt.pipeline.cli.execution import execute as execute
from flowsculpt.pipeline.cli.execution import execute_and_report as execute_and_report
from flowsculpt.pipeline.cli.execution import report_plan as report_plan
from flowsculpt.pipeline.cli.options import require_one_of as require_one_of
from flowsculpt.pipeline.cli.output import duration_words as duration_words
from flowsculpt.pipeline.cli.output import empty_table as empty_table
from flowsculpt.pipeline.cli.output import print_error as print_error
from flowsculpt.pipeline.cli.output import print_result as print_result
from flowsculpt.pipeline.cli.output import print_warning as print_warning
from flowsculpt.pipeline.cli.output import progress_bars as progress_bars
from flowsculpt.pipeline.cli.output import size_words as size_words
from flowsculpt.pipeline.production.execution.project import Project as Project
