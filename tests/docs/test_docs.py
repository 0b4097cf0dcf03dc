"""The documentation tells of what is there: links, files, tests and claims."""

import re
from pathlib import Path

import pytest

from tests.needed_plugins import is_of_installed

ROOT = Path(__file__).parents[2]
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").glob("*.md")])
NAMED = re.compile(r"`((?:pipeline|render|tests|examples|benchmarks|shots|profiles)/[\w/.-]*)`")
GENERATED = ("benchmarks/out/", "shots/.schema/", "shots/models", "shots/defaults.yaml")
"""Files and folders that commands make."""
CLAIM = re.compile(r"^\| (P\d+) \| (.+) \| (.+) \| (.+) \| (.+) \|$", re.MULTILINE)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_leads_somewhere(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text()):
        if "://" in target:
            continue
        path, _, anchor = target.partition("#")
        file = (page.parent / path).resolve() if path else page
        assert file.exists(), f"{page.name}: {target}"
        if anchor:
            assert anchor in anchors(file), f"{page.name}: {target}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_file_of_the_project_that_a_page_names_exists(page):
    named = filter(is_of_installed, NAMED.findall(page.read_text()))
    assert [name for name in named if name not in GENERATED and not (ROOT / name).exists()] == []


def test_every_claim_of_the_paper_has_code_a_test_and_a_figure():
    rows = CLAIM.findall((ROOT / "docs" / "paper.md").read_text())
    assert [number for number, *_ in rows] == [f"P{n}" for n in range(1, 41)]
    for number, _, code, test, shown in rows:
        if not (is_of_installed(code.strip("`")) and is_of_installed(test.strip("`"))):
            continue
        assert (ROOT / code.strip("`")).exists(), number
        file, _, name = test.strip("`").partition("::")
        assert f"def {name}(" in (ROOT / file).read_text() if name else (ROOT / file).exists(), (number, test)
        assert re.fullmatch(r"\[.+\]\(.+\)", shown), number


def test_every_fault_that_a_run_survives_has_tests():
    table = (ROOT / "docs" / "production.md").read_text().partition("## What a run survives")[2]
    rows = [line.split(" | ") for line in table.partition("A sign of life")[0].splitlines() if " | " in line]
    assert rows[0][2] == "shown by |" and len(rows) > 12
    for fault, _, tests in rows[1:]:
        shown = re.findall(r"`(tests/[\w/]+\.py)::(test_\w+)`", tests)
        assert shown, fault
        for file, name in shown:
            if is_of_installed(file):
                assert f"def {name}(" in (ROOT / file).read_text(), (fault, name)


def test_claims_are_cited_by_numbers_that_the_page_explains():
    cited = set()
    for folder in ("pipeline", "render", "examples"):
        for file in (ROOT / folder).rglob("*.py"):
            cited |= set(re.findall(r"\bP(\d{1,2})\b", file.read_text()))
    assert {int(number) for number in cited} <= set(range(1, 41))
    assert len(cited) > 25


def test_the_readme_is_short_and_leads_to_the_index_and_the_benchmarks():
    text = (ROOT / "README.md").read_text()
    assert text.count("\n") <= 100
    assert "(docs/index.md)" in text and "(docs/benchmarks.md)" in text


def test_the_index_leads_to_every_page():
    linked = set(re.findall(r"\]\(([\w-]+\.md)", (ROOT / "docs" / "index.md").read_text()))
    assert {page.name for page in (ROOT / "docs").glob("*.md")} - {"index.md"} <= linked


def anchors(page: Path) -> set[str]:
    """The anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ +(.+)$", page.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}
