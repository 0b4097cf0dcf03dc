"""The table of outputs, by which `verify` and `clean` know files."""

import re
from pathlib import Path

from flowsculpt.pipeline.plugins.maintenance.store_repair import OUTPUTS, output_folder
from tests.docs.test_docs import ROOT


def test_every_folder_of_output_is_in_the_list_of_files():
    """The table by which `verify` and `clean` know them, and the page, say the same."""
    listed = re.findall(r"^(renders/\S+)", (ROOT / "docs" / "architecture.md").read_text(), re.MULTILINE)
    paths = [re.sub(r"<(\w+)>|\{(\w+),[^}]*\}", r"\1\2", path).replace("…", "file.exr") for path in listed]
    known = {path: output_folder(Path(path)) for path in paths}
    assert [path for path, row in known.items() if row is None] == []
    assert {row[0] for row in known.values()} == {*OUTPUTS}
