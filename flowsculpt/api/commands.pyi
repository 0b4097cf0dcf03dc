"""What commands print, and the project in which they look up shots and run plans."""

from flowsculpt.pipeline.cli.execution import execute as execute
from flowsculpt.pipeline.cli.execution import execute_and_report as execute_and_report
from flowsculpt.pipeline.cli.execution import report_notes as report_notes
from flowsculpt.pipeline.cli.execution import report_plan as report_plan
from flowsculpt.pipeline.cli.options import require_one_of as require_one_of
from flowsculpt.pipeline.cli.output import duration as duration
from flowsculpt.pipeline.cli.output import exit_with as exit_with
from flowsculpt.pipeline.cli.output import frame_progress as frame_progress
from flowsculpt.pipeline.cli.output import print_error as print_error
from flowsculpt.pipeline.cli.output import print_result as print_result
from flowsculpt.pipeline.cli.output import print_warning as print_warning
from flowsculpt.pipeline.cli.output import progress_bars as progress_bars
from flowsculpt.pipeline.cli.output import size as size
from flowsculpt.pipeline.cli.output import table as table
from flowsculpt.pipeline.production.execution.project import Project as Project
