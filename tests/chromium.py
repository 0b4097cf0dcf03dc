"""A Chromium to look at pages with: Debian's, unpacked under the environment where none is installed.

    python tests/chromium.py fetch      unpack it and what it lacks, without root

Debian's headless shell is Chromium without its windows: the same page engine, and no toolkit to fetch.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from filelock import FileLock
from playwright.sync_api import Browser, Error, Page, sync_playwright

from flowsculpt.render.base.render_errors import MachineError
from flowsculpt.render.mitsuba.llvm import PrivateApt, apt_available

PACKAGES = ("chromium-headless-shell", "fonts-dejavu-core")

PROGRAMS = ("chromium-headless-shell", "chromium")

FETCHED = Path(sys.prefix) / "chromium"

FLAGS = (
    *("--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync"),
    *("--use-angle=swiftshader", "--enable-unsafe-swiftshader"),  # WebGL without a graphics card
)

LIMIT = 120.0
"""Seconds that a page may take for anything: it only ends a test that hangs."""

FONTS = """\
<?xml version="1.0"?>
<!DOCTYPE fontconfig SYSTEM "fonts.dtd">
<fontconfig>
<dir>/usr/share/fonts</dir>
<dir>{prefix}/usr/share/fonts</dir>
<cachedir>{prefix}/fonts</cachedir>
<match><edit name="family" mode="append_last"><string>DejaVu Sans</string></edit></match>
</fontconfig>
"""


class ChromiumError(Exception):
    """Chromium is not to be had here, or does not start; the message says why."""


@dataclass(frozen=True)
class Chromium:
    """Paths of a Chromium, installed or unpacked under a prefix."""

    prefix: Path

    @classmethod
    def found(cls) -> Chromium | None:
        return next((each for each in (cls(FETCHED), cls(Path("/"))) if each.programs), None)

    @property
    def programs(self) -> list[Path]:
        """Debian's own files; what is in usr/bin asks for a desktop's settings first."""
        places = (self.prefix / "usr/lib/chromium" / name for name in PROGRAMS)
        return [place for place in places if place.is_file()]

    @property
    def environment(self) -> dict[str, str]:
        """Variables by which it finds the libraries and fonts unpacked beside it."""
        if self.prefix != FETCHED:
            return {}
        patterns = ("usr/lib/*-linux-gnu*", "lib/*-linux-gnu*", "usr/lib/*-linux-gnu*/pulseaudio")
        libraries = [str(place) for pattern in patterns for place in sorted(self.prefix.glob(pattern))]
        libraries += [os.environ.get("LD_LIBRARY_PATH", "")]
        fonts = self.prefix / "fonts.conf"
        return {"LD_LIBRARY_PATH": ":".join(filter(None, libraries)), "FONTCONFIG_FILE": str(fonts)}


def fetch(time_limit: float = 300.0) -> None:
    """Unpack the packages into FETCHED, which appears whole or not at all, unless a Chromium is here.

    Raises ChromiumError where apt is missing, offers none, fails or takes too long.
    """
    try:
        with FileLock(FETCHED.with_suffix(".lock")):
            if Chromium.found() is None:
                _unpack(time_limit)
    except (MachineError, OSError) as error:
        raise ChromiumError(f"Chromium cannot be fetched: {error}") from None


def _unpack(time_limit: float) -> None:
    if not apt_available():
        raise ChromiumError("this system has no apt-get and dpkg, and no Chromium")
    with tempfile.TemporaryDirectory(dir=FETCHED.parent, prefix="chromium.tmp") as work:
        apt = PrivateApt(Path(work), time.monotonic() + time_limit)
        apt.update()
        missing = dict.fromkeys(name for package in PACKAGES for name in apt.missing_for(package))
        if PACKAGES[0] not in missing:
            raise ChromiumError(f"apt offers no {PACKAGES[0]}")
        unpacked = Path(work) / "unpacked"
        apt.unpack(list(missing), unpacked)
        (unpacked / "fonts.conf").write_text(FONTS.format(prefix=FETCHED))
        shutil.rmtree(FETCHED, ignore_errors=True)
        unpacked.replace(FETCHED)


@contextmanager
def running() -> Iterator[Browser]:
    """A browser at work, with a profile of its own that is gone afterwards.

    Raises ChromiumError where there is none, or it does not start.
    """
    found = Chromium.found()
    if found is None:
        raise ChromiumError("Chromium is not here; python tests/chromium.py fetch unpacks it")
    with sync_playwright() as playwright:
        try:
            browser = playwright.chromium.launch(
                executable_path=found.programs[0],
                args=list(FLAGS),
                env={**os.environ, **found.environment},
            )
        except Error as error:
            raise ChromiumError(f"Chromium does not start: {str(error).splitlines()[0]}") from None
        try:
            yield browser
        finally:
            browser.close()


def wait_for(tab: Page, condition: str) -> None:
    """Wait until an expression is true. The page's own policy forbids Playwright's `wait_for_function`."""
    limit = time.monotonic() + LIMIT
    while not tab.evaluate(f"Boolean({condition})"):
        assert time.monotonic() < limit, f"waited in vain for {condition}"
        tab.wait_for_timeout(20)


def main(words: list[str]) -> int:
    if words != ["fetch"]:
        print(__doc__, file=sys.stderr)
        return 2
    try:
        fetch()
    except ChromiumError as error:
        print(error, file=sys.stderr)
        return 4
    print(f"Chromium: {Chromium.found()}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
