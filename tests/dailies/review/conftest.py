"""Shared fixtures of the review page: a browser, and a page of numbered pictures."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser

from tests.dailies.review.chromium import ChromiumError, fetch, running
from tests.dailies.review.studio import NAME, Desk, furnish


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """Debian's Chromium, which is fetched where it is not here; skips where it cannot be had.

    It ends with the module, for while it is there an event loop runs in this process.
    """
    try:
        fetch()
        with running() as found:
            yield found
    except ChromiumError as error:
        pytest.skip(f"no browser: {error}")


@pytest.fixture(scope="session")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Desk:
    """A studio with numbered pictures, and the page of them written."""
    root = tmp_path_factory.mktemp("review")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(root)
        made = furnish(root)
        code, words = made.command("review", NAME)
    assert code == 0, words
    return made
