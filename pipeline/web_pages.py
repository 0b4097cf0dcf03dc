"""Pages for browsers: the style and the scripts that all share, in `web/`, and those of one page after them.

A page is a folder with index.html, `*.css` and `*.js`. Scripts declare; `main.js`, the last, begins. Shared:

style.css    colours in light and dark, type, controls, the ring of the focus, bars, strip, messages, help
elements     elements, buttons, lists and sliders; `icons`, `vectors`, `packed` data, `messages`
keyboard     the keys of a page, and their help; arrow keys of an element
gestures     mouse, pen, fingers and trackpad on an element; `orbit` turns a camera by them
transport    time: frames, loops, speeds; `playback` has its controls and keys, `strip` shows the frames
"""

from __future__ import annotations

import html
import re
from collections.abc import Mapping
from importlib.resources import files
from importlib.resources.abc import Traversable

SHARED = files("flowsculpt.pipeline") / "web"


def page_style(page: Traversable) -> str:
    """Return all styles of a page as one."""
    return "".join(_texts(page, ".css"))


def page_script(page: Traversable) -> str:
    """Return all scripts of a page as one."""
    return "".join(['"use strict";\n', *_texts(page, ".js")])


def single_page(page: Traversable, title: str, data: Mapping[str, str]) -> str:
    """Return a page as one file that asks for nothing else. JSON `data` is in elements with these ids."""
    parts = {
        "title": html.escape(title),
        "style": page_style(page),
        "script": page_script(page),
        **{name: text.replace("<", "\\u003c") for name, text in data.items()},
    }
    text = (page / "index.html").read_text(encoding="utf-8")
    return re.sub(r"\[\[(\w+)\]\]", lambda match: parts[match[1]], text)


def _texts(page: Traversable, suffix: str) -> list[str]:
    found = [file for folder in (SHARED, page) for file in sorted(folder.iterdir(), key=_order)]
    return [file.read_text(encoding="utf-8") for file in found if file.name.endswith(suffix)]


def _order(file: Traversable) -> tuple[bool, str]:
    return file.name == "main.js", file.name
