"""Pages for browsers: the style and the scripts that all share, in `web/`, and those of one page after them.

A page is a folder with index.html, the body of its document, `*.css` and `*.js`. Scripts declare; `main.js`,
the last, begins. Shared:

page.html    the document around a body: what it may load, its title, style and scripts
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
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from importlib.resources.abc import Traversable

from flowsculpt.render.graphics.three_js import three_js_script

SHARED = files("flowsculpt.render.graphics") / "web"

_LINKED = (
    "script-src 'self' file: blob:; style-src 'self' file:; img-src 'self' file: data:; connect-src {connect}"
)

_INLINE = "script-src 'unsafe-inline' blob:; style-src 'unsafe-inline'; img-src 'self' file: data: blob:"


@dataclass(frozen=True)
class PageFolder:
    """The folder of a page in its plug-in."""

    folder: Traversable

    three_js = staticmethod(three_js_script)

    @property
    def style(self) -> str:
        """All styles of the page as one."""
        return "".join(self._texts(".css"))

    @property
    def script(self) -> str:
        """All scripts of the page as one."""
        return "".join(['"use strict";\n', *self._texts(".js")])

    def linked(self, title: str, style: str, scripts: Sequence[str], connect: str = "'none'") -> str:
        """Return the page as a document that loads these files; `connect` is whom it may send requests to."""
        return self._document(
            title=html.escape(title),
            policy=_LINKED.format(connect=connect),
            style=f'<link rel="stylesheet" href="{style}">',
            script="\n".join(f'<script src="{name}"></script>' for name in scripts),
        )

    def in_one_file(self, title: str, data: Mapping[str, str]) -> str:
        """Return the page as one file that asks for nothing else; `data` is JSON by the id of its element."""
        texts = {name: text.replace("<", "\\u003c") for name, text in data.items()}
        held = [f'<script id="{n}" type="application/json">{text}</script>\n' for n, text in texts.items()]
        return self._document(
            title=html.escape(title),
            policy=_INLINE,
            style=f"<style>\n{self.style}</style>",
            script=f"{''.join(held)}<script>\n{self.script}</script>",
        )

    def _document(self, **parts: str) -> str:
        body = (self.folder / "index.html").read_text(encoding="utf-8").rstrip()
        text = (SHARED / "page.html").read_text(encoding="utf-8").replace("[[body]]", body)
        return re.sub(r"\[\[(\w+)\]\]", lambda match: parts[match[1]], text)

    def _texts(self, suffix: str) -> list[str]:
        found = [file for folder in (SHARED, self.folder) for file in sorted(folder.iterdir(), key=_order)]
        return [file.read_text(encoding="utf-8") for file in found if file.name.endswith(suffix)]


def _order(file: Traversable) -> tuple[bool, str]:
    return file.name == "main.js", file.name
