"""Settings of the documentation as a site: `make docs` builds docs/site from the pages of this folder."""

from __future__ import annotations

import gc
import re
import sys
import tomllib
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parent
sys.path[:0] = [str(DOCS), str(DOCS.parent)]  # the library is documented as it is in this checkout

import public_names  # noqa: E402

gc.disable()  # pages stay until the site is written: to look for garbage takes a third of the time

ENTRIES = "(Built as a site, this page has an entry for each name.)\n"
"""What stands in api.md where its entries come."""

PACKAGE = tomllib.loads((DOCS.parent / "pyproject.toml").read_text())["project"]

REPOSITORY = PACKAGE.get("urls", {}).get("Repository", "").rstrip("/")
FILES = f"{REPOSITORY}/blob/main/" if REPOSITORY else ""

SHOT_FILE = """
```{{raw}} html
<details><summary><code>shots/{name}.yaml</code></summary>
```
```{{literalinclude}} ../shots/{name}.yaml
:language: yaml
```
```{{raw}} html
</details>
```
"""

project = "flowsculpt"
author = "The authors of flowsculpt"
release = version = PACKAGE["version"]

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.viewcode"]
autodoc_default_options = {"members": True, "member-order": "bysource"}
autodoc_typehints = "none"  # public_names.py writes them
python_maximum_signature_line_length = 88
master_doc = "index"
exclude_patterns = ["site", "pictures"]
myst_heading_anchors = 4
myst_enable_extensions = ["attrs_block"]

highlight_language = "text"  # of blocks that name none

html_theme = "furo"
html_title = f"flowsculpt {version}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
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


def _stills(page: str) -> str:
    """Return the gallery with a grid of its stills on top, and each shot's file below its description."""
    sections = re.split(r"^(?=## )", page, flags=re.MULTILINE)
    grid, shots = ["{.stills}"], []
    for section in sections[1:]:
        name, title, picture = re.findall(r"^## (\w+)\n\n!\[(.+)\]\((.+)\)$", section, re.MULTILINE)[0]
        grid.append(f"[![{title}]({picture})](#{name.lower()})")
        shots.append(section + SHOT_FILE.format(name=name))
    return "\n".join([sections[0], *grid, "", *shots])


def _adapt(app: Any, name: str, source: list[str]) -> None:
    """Give pages what only the site has: tables of contents, the entries of the library, the grid of stills.

    Links to files beside the docs lead to the repository, if the package names one; else only names are left.
    """
    source[0] = re.sub(r"\[([^\]]+)\]\(\.\./([^)]+)\)", rf"[\1]({FILES}\2)" if FILES else r"\1", source[0])
    if name == master_doc:
        source[0] += f"\n{_contents(source[0])}\n"
    elif name == "api":
        source[0] = source[0].replace(ENTRIES, public_names.entries())
    elif name == "gallery":
        source[0] = _stills(source[0])


def setup(app: Any) -> dict[str, bool]:
    """Connect what this file adds to Sphinx."""
    app.connect("source-read", _adapt)
    app.connect("autodoc-skip-member", public_names.is_inherited)
    app.connect("autodoc-process-signature", public_names.write_signature)
    app.connect("autodoc-process-docstring", public_names.format_docstring)
    return {"parallel_read_safe": True}
