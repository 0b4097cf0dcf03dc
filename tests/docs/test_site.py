"""The documentation as a site: it builds without a warning, and every link in it leads somewhere."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any
from urllib.parse import unquote, urlsplit

import pytest
from playwright.sync_api import Browser
from ruamel.yaml import YAML

import flowsculpt
from tests.chromium import LIMIT
from tests.needed_plugins import SHIPPED, needs_plugins

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
ATTRIBUTE = re.compile(r'\b(?:href|src)="([^"]*)"')
ANCHOR = re.compile(r'\bid="([^"]+)"')


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built as `make docs` does; a warning is an error."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", DOCS, folder]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return folder


class QuietHandler(SimpleHTTPRequestHandler):
    """Serves a folder and writes no log."""

    def log_message(self, format: str, *args: Any) -> None: ...


def test_every_page_of_the_docs_is_in_the_site_and_its_contents(site: Path) -> None:
    contents = (site / "index.html").read_text()
    for page in DOCS.glob("*.md"):
        assert (site / f"{page.stem}.html").is_file()
        assert (
            page.stem == "index" or f'<a class="reference internal" href="{page.stem}.html">' in contents
        ), page


def test_every_link_and_picture_of_the_site_is_there(site: Path) -> None:
    pages = {page: page.read_text() for page in site.glob("*.html")}
    anchors = {page: set(ANCHOR.findall(text)) for page, text in pages.items()}
    for page, text in pages.items():
        for target in ATTRIBUTE.findall(text):
            link = urlsplit(target)
            if link.scheme or link.netloc:
                assert link.scheme in ("https", "data"), f"{page.name}: {target}"
                continue
            file = (page.parent / unquote(link.path)).resolve() if link.path else page
            assert file.exists(), f"{page.name}: {target}"
            if link.fragment and file in anchors:
                assert unquote(link.fragment) in anchors[file], f"{page.name}: {target}"


def test_every_public_name_of_the_library_has_a_readable_entry(site: Path) -> None:
    page = (site / "api.html").read_text()
    assert {f"flowsculpt.{name}" for name in flowsculpt.__all__} <= set(ANCHOR.findall(page))
    for entry in re.findall(r'<dt class="sig.+?<dd>(.*?)</dd>', page, re.DOTALL):
        assert entry.strip(), "every entry has a docstring"
    text = re.sub(r"<[^>]+>", "", page)
    assert not re.findall(r"&lt;[\w.]+ object|0x[0-9a-f]{6}|&lt;factory&gt;|ndarray\[tuple", text)


def test_every_shot_of_the_gallery_is_in_its_grid_with_its_file(site: Path) -> None:
    page = (site / "gallery.html").read_text()
    grid = page.partition('<p class="stills">')[2].partition("</p>")[0]
    shots = re.findall(r"^## (\w+)$", (DOCS / "gallery.md").read_text(), re.MULTILINE)
    assert re.findall(r"_images/(\w+)\.webp", grid) == shots
    assert re.findall(r"<code>shots/(\w+)\.yaml</code>", page) == shots


@pytest.mark.slow
def test_a_search_finds_its_pages_on_a_server_and_from_a_folder(site: Path, browser: Browser) -> None:
    handler = partial(QuietHandler, directory=str(site))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        for address in (f"http://127.0.0.1:{server.server_port}", site.as_uri()):
            tab = browser.new_page()
            tab.goto(f"{address}/index.html")
            tab.fill("input[name=q]", "cryptomatte")
            tab.keyboard.press("Enter")
            tab.wait_for_selector("#search-results a[href^='compositing.html']", timeout=1000 * LIMIT)
            tab.close()
        server.shutdown()


@pytest.mark.slow
def test_every_page_is_as_narrow_as_a_phone(site: Path, browser: Browser) -> None:
    tab = browser.new_page(viewport={"width": 390, "height": 844})
    widths = {}
    for page in site.glob("*.html"):
        tab.goto(page.as_uri(), wait_until="domcontentloaded", timeout=1000 * LIMIT)
        widths[page.name] = tab.evaluate("document.documentElement.scrollWidth")
    tab.close()
    assert {name: width for name, width in widths.items() if width > 390} == {}


def page_from_the_code(name: str) -> tuple[str, str]:
    """Return a page as its script writes it now, and as it stands in the docs."""
    spec: Any = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    return script.page(), (DOCS / f"{name}.md").read_text()


@needs_plugins(*SHIPPED)
def test_the_page_of_commands_says_what_the_code_says() -> None:
    new, old = page_from_the_code("commands")
    assert new == old, "`make reference` rewrites the page"


def test_the_page_of_names_for_plug_ins_says_what_the_code_says() -> None:
    new, old = page_from_the_code("plugin_names")
    assert new == old, "`make reference` rewrites the page"
    assert not [line for line in new.splitlines() if line.endswith("|  |")], "each name has a docstring"


@needs_plugins("remote")
def test_every_message_that_troubleshooting_quotes_is_told_by_the_code() -> None:
    code = "\n".join(
        file.read_text() for folder in ("pipeline", "render") for file in (ROOT / folder).rglob("*.py")
    )
    code += (ROOT / "Makefile").read_text()
    rows = re.findall(r"^\| (`.+?) \|", (DOCS / "troubleshooting.md").read_text(), re.MULTILINE)
    quoted = [words for row in rows for words in re.findall(r"`([^`]+ [^`]+)`", row)]
    assert len(quoted) >= 3
    assert [words for words in quoted if words not in code] == []


def test_the_citation_and_the_changes_name_the_version_of_the_package() -> None:
    version = re.search(r'^version = "(.+)"', (ROOT / "pyproject.toml").read_text(), re.MULTILINE)
    assert version is not None
    citation = YAML(typ="safe").load((ROOT / "CITATION.cff").read_text())
    assert str(citation["version"]) == version[1]
    assert {"cff-version", "message", "title", "authors", "license", "references"} <= set(citation)
    assert f"\n## {version[1]}\n" in (ROOT / "CHANGELOG.md").read_text()
