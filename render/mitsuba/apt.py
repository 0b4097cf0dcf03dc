"""Unpack a Debian or Ubuntu package and its missing dependencies into a folder, without root.

apt gets private lists and a private cache: it writes nothing outside the folder and only reads the system's
package database. Missing dependencies are found by a simulated installation.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

from render.base.errors import MachineError

_NEW_PACKAGE = re.compile(r"^Inst (\S+) \(", re.MULTILINE)


def available() -> bool:
    """Tell whether this machine has apt and dpkg."""
    return all(shutil.which(tool) for tool in ("apt-get", "dpkg"))


@dataclass(frozen=True)
class PrivateApt:
    """apt-get working under `folder` (lists/, cache/, debs/), bound by a deadline of `time.monotonic`."""

    folder: Path
    deadline: float

    def update(self) -> None:
        """Fetch the lists of packages. Raises MachineError."""
        for name in ("lists/partial", "cache/archives/partial", "debs"):
            (self.folder / name).mkdir(parents=True, exist_ok=True)
        self._run("update")

    def missing_for(self, package: str) -> list[str]:
        """Return the packages that installing `package` would add; empty where apt does not offer it."""
        try:
            plan = self._run("install", "--simulate", "--no-install-recommends", package)
        except MachineError:
            self._check_time("apt-get install --simulate")
            return []
        return _NEW_PACKAGE.findall(plan)

    def unpack(self, packages: list[str], target: Path) -> None:
        """Download packages and unpack them below `target`. Raises MachineError."""
        self._run("download", *packages)
        for archive in sorted((self.folder / "debs").glob("*.deb")):
            self._call(["dpkg", "-x", str(archive), str(target)])

    def _run(self, *arguments: str) -> str:
        options = {
            "Dir::State::Lists": str(self.folder / "lists"),
            "Dir::Cache": str(self.folder / "cache"),
            "APT::Sandbox::User": "",
            "Acquire::Languages": "none",
            "Acquire::Retries": "1",
            "Acquire::http::Timeout": "20",
            "Acquire::https::Timeout": "20",
            "Debug::NoLocking": "true",
        }
        settings = [word for key, value in options.items() for word in ("-o", f"{key}={value}")]
        return self._call(["apt-get", "-q", "-y", *settings, *arguments])

    def _call(self, command: list[str]) -> str:
        self._check_time(command[0])
        try:
            done = subprocess.run(
                command,
                cwd=self.folder / "debs",
                capture_output=True,
                text=True,
                stdin=subprocess.DEVNULL,
                env={**os.environ, "LC_ALL": "C", "DEBIAN_FRONTEND": "noninteractive"},
                timeout=self.deadline - time.monotonic(),
            )
        except subprocess.TimeoutExpired:
            raise MachineError(f"{command[0]} took too long") from None
        except OSError as error:
            raise MachineError(f"{command[0]} cannot run: {error.strerror}") from None
        if done.returncode != 0:
            errors = [line for line in done.stderr.splitlines() if line.startswith(("E:", "dpkg"))]
            reason = errors[0].removeprefix("E: ") if errors else f"exit code {done.returncode}"
            raise MachineError(f"{command[0]} failed: {reason}")
        return done.stdout

    def _check_time(self, command: str) -> None:
        if time.monotonic() >= self.deadline:
            raise MachineError(f"no time left for {command}")
