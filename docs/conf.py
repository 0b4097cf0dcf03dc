"""Settings of the documentation as a site: `make docs` builds docs/site from the pages of this folder."""

from __future__ import annotations

import re
from importlib.metadata import version as installed_version
from typing import Any

project = "flowsculpt"
author = "The authors of flowsculpt"
release = version = installed_version("flowsculpt")

extensions = ["myst_parser"]
master_doc = "index"
exclude_patterns = ["site", "pictures"]
myst_heading_anchors = 4

highlight_language = "text"  # of blocks that name none

html_theme = "furo"
html_title = "flowsculpt"
html_static_path: list[str] = []
html_show_copyright = False
html_copy_source = False
html_theme_options = {
    "light_css_variables": {"color-brand-primary": "#8a3b12", "color-brand-content": "#8a3b12"},
    "dark_css_variables": {"color-brand-primary": "#e8a27c", "color-brand-content": "#e8a27c"},
}
pygments_style = "friendly"
pygments_dark_style = "native"


def _contents(page: str) -> str:
    """Return the tables of contents of the site: for each section of index.md, the pages that it lists."""
    tables = []
    for section in re.split(r"^## ", page, flags=re.MULTILINE)[1:]:
        caption, _, rest = section.partition("\n")
        names = dict.fromkeys(re.findall(r"\]\(([\w-]+)\.md", rest))
        tables.append("\n".join(["```{toctree}", ":hidden:", f":caption: {caption}", "", *names, "```"]))
    return "\n\n".join(tables)


def _adapt(app: Any, name: str, source: list[str]) -> None:
    """Give the index its tables of contents; name files beside the docs in place of links to them."""
    source[0] = re.sub(r"\[([^\]]+)\]\(\.\./[^)]+\)", r"\1", source[0])
    if name == master_doc:
        source[0] += f"\n{_contents(source[0])}\n"


def setup(app: Any) -> dict[str, bool]:
    """Connect what this file adds to Sphinx."""
    app.connect("source-read", _adapt)
    return {"parallel_read_safe": True}
