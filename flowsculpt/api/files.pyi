"""Files read within limits, written whole or not at all, kept or parsed apart, and pages for browsers."""

from flowsculpt.render.base.atomic_write import ChangedFileError as ChangedFileError
from flowsculpt.render.base.atomic_write import atomic_folder as atomic_folder
from flowsculpt.render.base.atomic_write import atomic_write as atomic_write
from flowsculpt.render.base.atomic_write import disk_errors as disk_errors
from flowsculpt.render.base.atomic_write import make_folder as make_folder
from flowsculpt.render.base.atomic_write import write_text as write_text
from flowsculpt.render.base.drafts import sweep_hidden_drafts as sweep_hidden_drafts
from flowsculpt.render.base.file_contents import Archive as Archive
from flowsculpt.render.base.file_contents import number_fault as number_fault
from flowsculpt.render.base.file_contents import text_content as text_content
from flowsculpt.render.base.input_files import InputFile as InputFile
from flowsculpt.render.base.limited_process import Parser as Parser
from flowsculpt.render.base.python_process import ForkedProcess as ForkedProcess
from flowsculpt.render.base.python_process import python_command as python_command
from flowsculpt.render.base.root_files import remove_file as remove_file
from flowsculpt.render.base.root_files import remove_tree as remove_tree
from flowsculpt.render.base.serialise import from_plain as from_plain
from flowsculpt.render.base.serialise import to_plain as to_plain
from flowsculpt.render.base.user_cache import CachedAnswer as CachedAnswer
from flowsculpt.render.graphics.web_pages import PageFolder as PageFolder
