"""Pages for browsers: what all share comes first, and a page in one file asks for nothing else."""

from __future__ import annotations

import html
import json
import re
from pathlib import Path

import pytest

from flowsculpt.render.graphics.web_pages import SHARED, PageFolder


@pytest.fixture
def page(tmp_path: Path) -> Path:
    (tmp_path / "index.html").write_text("<main>[[title]]</main>")
    (tmp_path / "page.css").write_text("main { color: red; }\n")
    (tmp_path / "main.js").write_text("begin();\n")
    (tmp_path / "parts.js").write_text("const parts = 1;\n")
    return tmp_path


def test_a_pages_own_files_follow_the_shared_ones_and_its_beginning_is_last(page: Path) -> None:
    script = PageFolder(page).script
    assert script.startswith('"use strict";\n') and script.endswith("const parts = 1;\nbegin();\n")
    assert (SHARED / "transport.js").read_text(encoding="utf-8") in script
    assert PageFolder(page).style.startswith((SHARED / "style.css").read_text(encoding="utf-8"))
    assert PageFolder(page).style.endswith("main { color: red; }\n")


def test_titles_and_data_are_text_on_a_page_in_one_file(page: Path) -> None:
    attack = "</script><script>[[style]]"
    text = PageFolder(page).in_one_file(attack, {"facts": json.dumps({"title": attack})})
    assert text.count("<script") == text.count("</script>") == 2
    assert f"<main>{html.escape(attack)}</main>" in text
    held = re.search(r'<script id="facts" type="application/json">(.*)</script>', text)
    assert held and json.loads(held[1]) == {"title": attack}
    assert "connect-src" not in text and not re.search('(src|href)="(?!data:)', text)


def test_a_page_that_loads_its_files_runs_these_scripts_alone(page: Path) -> None:
    text = PageFolder(page).linked("Rushes", "page.css", ("data.js", "page.js"))
    assert re.findall(r'src="([^"]+)"', text) == ["data.js", "page.js"]
    assert "unsafe-inline" not in text and "connect-src 'none'" in text
    assert "connect-src 'self'" in PageFolder(page).linked("Live", "page.css", (), connect="'self'")
