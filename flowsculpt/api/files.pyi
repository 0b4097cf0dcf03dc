"""Files: read within limits, written whole or not at all, kept between runs, parsed in own processes."""

from flowsculpt.pipeline.file_contents import as_utf8 as as_utf8
from flowsculpt.render.base.atomic_write import ChangedFileError as ChangedFileError
from flowsculpt.render.base.atomic_write import atomic_folder as atomic_folder
from flowsculpt.render.base.atomic_write import atomic_write as atomic_write
from flowsculpt.render.base.atomic_write import disk_errors as disk_errors
from flowsculpt.render.base.atomic_write import machine_error as machine_error
from flowsculpt.render.base.atomic_write import make_folder as make_folder
from flowsculpt.render.base.drafts import sweep_hidden_drafts as sweep_hidden_drafts
from flowsculpt.render.base.input_files import digest_of_file as digest_of_file
from flowsculpt.render.base.input_files import read_input as read_input
from flowsculpt.render.base.input_files import require_input as require_input
from flowsculpt.render.base.limited_process import Parser as Parser
from flowsculpt.render.base.limited_process import ParserError as ParserError
from flowsculpt.render.base.python_process import ForkedProcess as ForkedProcess
from flowsculpt.render.base.python_process import command as command
from flowsculpt.render.base.python_process import environment as environment
from flowsculpt.render.base.python_process import user_environment as user_environment
from flowsculpt.render.base.root_files import remove as remove
from flowsculpt.render.base.root_files import remove_tree as remove_tree
from flowsculpt.render.base.serialise import from_plain as from_plain
from flowsculpt.render.base.serialise import to_plain as to_plain
from flowsculpt.render.base.state_files import read_state as read_state
from flowsculpt.render.base.state_files import usable as usable
from flowsculpt.render.base.user_cache import CachedAnswer as CachedAnswer
from flowsculpt.render.base.user_cache import writable_cache as writable_cache
