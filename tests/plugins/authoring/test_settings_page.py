"""The page of all settings, which comes from the schemas of shot files."""

from __future__ import annotations

from tests.docs.test_site import page_from_the_code
from tests.needed_plugins import SHIPPED, needs_plugins


@needs_plugins(*SHIPPED)
def test_the_page_of_settings_says_what_the_code_says() -> None:
    new, old = page_from_the_code("settings")
    assert new == old, "`make reference` rewrites the page"
