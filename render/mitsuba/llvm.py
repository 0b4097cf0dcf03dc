"""Find a libLLVM that Dr.Jit can use, and fetch one where there is none.

By default Dr.Jit takes the first libLLVM it finds. Versions 15 and 16 end the process with SIGABRT at the
first render, and 14 is refused. So a library of version 17 or later is always named to it.
"""

from __future__ import annotations

import ctypes
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from flowsculpt.render.base.render_errors import MachineError

OLDEST_VERSION = 17
ENVIRONMENT_NAME = "DRJIT_LIBLLVM_PATH"
PACKAGES = ("libllvm19", "libllvm18", "libllvm20", "libllvm17")
"""In order of preference: this project is tested with 19."""

TIME_LIMIT = 300.0
"""Seconds that fetching may take before set-up continues without it."""

_VERSION = re.compile(r"libLLVM(?:-|\.so\.)(\d+)")
_NEW_PACKAGE = re.compile(r"^Inst (\S+) \(", re.MULTILINE)
_SYSTEM_FOLDERS = (
    "/usr/lib/*-linux-gnu",
    "/usr/lib64",
    "/usr/lib",
    "/usr/local/lib",
    "/usr/lib/llvm-*/lib",
    "/opt/homebrew/opt/llvm*/lib",
    "/usr/local/opt/llvm*/lib",
)


@dataclass(frozen=True)
class LibLlvm:
    """One libLLVM on this machine.

    path          the library
    dependencies  libraries unpacked with it that the loader would not find by itself
    """

    path: Path
    dependencies: tuple[Path, ...] = ()

    @property
    def version(self) -> int | None:
        """The major version, or None where the file's name does not have it."""
        return _version_of(self.path)

    def load(self) -> None:
        """Name this library to Dr.Jit and load its dependencies. Must come before `import mitsuba`.

        Dependencies may need each other, so those that fail are tried again while others succeed.
        """
        waiting = list(self.dependencies)
        while waiting:
            failed = [path for path in waiting if not _loads(path)]
            if len(failed) == len(waiting):
                break
            waiting = failed
        os.environ[ENVIRONMENT_NAME] = str(self.path)


def provisioned_folder() -> Path:
    """Return the folder where set-up unpacks a libLLVM of our own."""
    return Path(sys.prefix) / "lib" / "libllvm"


def candidates() -> list[LibLlvm]:
    """Return libraries to probe, best first: the environment's of any version, set-up's, the system's
    newest.
    """
    found = [LibLlvm(Path(os.environ[ENVIRONMENT_NAME]))] if os.environ.get(ENVIRONMENT_NAME) else []
    found += _in_folder(provisioned_folder())
    system = {path.resolve() for folder in _SYSTEM_FOLDERS for path in _libraries(folder)}
    found += [LibLlvm(path) for path in sorted(system, key=lambda p: (_version_of(p) or 0, p), reverse=True)]
    return found


def provision(folder: Path, time_limit: float = TIME_LIMIT) -> str:
    """Unpack a libLLVM into `folder`, complete or not at all, and return the package's name.

    Raises MachineError where apt is missing, offers none, fails or takes too long.
    """
    if not apt_available():
        raise MachineError("this system has no apt-get and dpkg")
    with _temporary_folder(folder) as work:
        apt = PrivateApt(work, time.monotonic() + time_limit)
        apt.update()
        for package in PACKAGES:
            missing = apt.missing_for(package)
            if missing:
                apt.unpack(missing, work / "unpacked")
                break
        else:
            raise MachineError(f"apt offers none of {', '.join(PACKAGES)}")
        if not _in_folder(work / "unpacked"):
            raise MachineError(f"{package} holds no libLLVM")
        shutil.rmtree(folder, ignore_errors=True)
        (work / "unpacked").replace(folder)
    return package


@contextmanager
def _temporary_folder(folder: Path) -> Iterator[Path]:
    """Yield a temporary folder next to `folder`, after removing those of killed runs."""
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        for leftover in folder.parent.glob(f"{folder.name}.tmp*"):
            shutil.rmtree(leftover, ignore_errors=True)
        work = Path(tempfile.mkdtemp(prefix=f"{folder.name}.tmp", dir=folder.parent))
    except OSError as error:
        raise MachineError(f"{folder.parent} cannot be written: {error.strerror}") from None
    try:
        yield work
    except OSError as error:
        raise MachineError(f"{folder} cannot be written: {error.strerror}") from None
    finally:
        shutil.rmtree(work, ignore_errors=True)


def _in_folder(folder: Path) -> list[LibLlvm]:
    files = [path for path in sorted(folder.rglob("*.so*")) if path.is_file() and not path.is_symlink()]
    dependencies = tuple(path for path in files if not path.name.startswith("libLLVM"))
    return [LibLlvm(path, dependencies) for path in files if (_version_of(path) or 0) >= OLDEST_VERSION]


def _libraries(pattern: str) -> Iterator[Path]:
    for folder in Path("/").glob(pattern.lstrip("/")):
        yield from (
            path
            for path in (*folder.glob("libLLVM*.so*"), *folder.glob("libLLVM.dylib"))
            if (_version_of(path.resolve()) or OLDEST_VERSION) >= OLDEST_VERSION
        )


def _version_of(path: Path) -> int | None:
    match = _VERSION.match(path.name)
    return int(match.group(1)) if match else None


def _loads(path: Path) -> bool:
    try:
        ctypes.CDLL(str(path), mode=ctypes.RTLD_GLOBAL)
    except OSError:
        return False
    return True


def apt_available() -> bool:
    """Tell whether this machine has apt and dpkg."""
    return all(shutil.which(tool) for tool in ("apt-get", "dpkg"))


@dataclass(frozen=True)
class PrivateApt:
    """apt-get without root, in `folder` (lists/, cache/, debs/), until a deadline of `time.monotonic`.

    It gets private lists and a private cache: it writes nothing outside the folder and only reads the
    system's package database. Missing dependencies are found by a simulated installation.
    """

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
