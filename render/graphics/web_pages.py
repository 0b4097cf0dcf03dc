"""Pages for browsers: the style and the scripts that all share, in `web/`, and those of one page after them.

A page is a folder with index.html, `*.css` and `*.js`. Scripts declare; `main.js`, the last, begins. Shared:

style.css    colours in light and dark, type, controls, the ring of the focus, bars, strip, messages, help
elements     elements, buttons, lists and sliders that show how things are; icons, messages
keyboard     the keys of a page, and their help; arrow keys of an element
gestures     mouse, pen, fingers and trackpad on an element
orbit        vectors, a camera turned by gestures, and views of three.js through it
transport    time: frames, loops, speeds; `playback` has its controls and keys, and the strip of frames
data         packed data and modules in pages, and files to be kept
"""

from __future__ import annotations

import html
import re
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from importlib.resources.abc import Traversable

from flowsculpt.render.graphics.three_js import three_js_script

SHARED = files("flowsculpt.render.graphics") / "web"


@dataclass(frozen=True)
class PageFolder:
    """The folder of a page in its plug-in."""

    folder: Traversable

    three_js = staticmethod(three_js_script)

    @property
    def index(self) -> str:
        return (self.folder / "index.html").read_text(encoding="utf-8")

    @property
    def style(self) -> str:
        """All styles of the page as one."""
        return "".join(self._texts(".css"))

    @property
    def script(self) -> str:
        """All scripts of the page as one."""
        return "".join(['"use strict";\n', *self._texts(".js")])

    def in_one_file(self, title: str, data: Mapping[str, str]) -> str:
        """Return the page as one file that asks for nothing else; `data` is JSON by name."""
        parts = {
            "title": html.escape(title),
            "style": self.style,
            "script": self.script,
            **{name: text.replace("<", "\\u003c") for name, text in data.items()},
        }
        return re.sub(r"\[\[(\w+)\]\]", lambda match: parts[match[1]], self.index)

    def _texts(self, suffix: str) -> list[str]:
        found = [file for folder in (SHARED, self.folder) for file in sorted(folder.iterdir(), key=_order)]
        return [file.read_text(encoding="utf-8") for file in found if file.name.endswith(suffix)]


def _order(file: Traversable) -> tuple[bool, str]:
    return file.name == "main.js", file.name
