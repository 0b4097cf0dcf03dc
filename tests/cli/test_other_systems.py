"""Other systems lack modules of POSIX: without them everything is imported, and shots are planned."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from flowsculpt.render.base import python_process
from tests.needed_plugins import missing

LACKING = """
import builtins, os, pkgutil, signal, sys

def imported(name, namespace=None, *rest, given=builtins.__import__):
    importer = (namespace or {}).get("__name__", "")
    if name in ("fcntl", "grp", "pwd", "resource", "termios") and importer.startswith("flowsculpt."):
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)
    return given(name, namespace, *rest)

builtins.__import__ = imported
for owner, names in {
    os: "O_CLOEXEC O_NONBLOCK fork killpg nice pread register_at_fork sched_getaffinity setsid",
    signal: "SIGBUS SIGCONT SIGHUP SIGKILL SIGQUIT SIGSTOP SIGTSTP pthread_sigmask",
}.items():
    for name in names.split():
        delattr(owner, name)
os.process_cpu_count = os.cpu_count  # as Python 3.13 has it where threads are not bound to cores
"""
"""Takes away from our packages what Windows lacks; libraries choose their parts by the system itself."""

pytestmark = [pytest.mark.slow, pytest.mark.renderer]

SHOT = "{title: A, frames: 1-2, subject: {solid: sheet}, resample: {max_edge_length: 1}, flows: []}"


def run(code: str, folder: Path, *words: str) -> str:
    done = subprocess.run(
        [sys.executable, "-P", "-c", LACKING + code, *words],
        env=python_process.environment(),
        cwd=folder,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_every_module_is_imported_where_modules_of_posix_are_missing(tmp_path: Path) -> None:
    code = (
        "import mitsuba\nfrom flowsculpt import pipeline, render\n"
        "mitsuba.set_variant('scalar_rgb')\n"  # some modules define plug-ins of it
        "for package in (pipeline, render):\n"
        "    for module in pkgutil.walk_packages(package.__path__, package.__name__ + '.'):\n"
        "        if not module.name.endswith(('__main__', '.kernel_compiler')):\n"  # which act on import
        "            __import__(module.name)\n"
        "print(sum(name.startswith('flowsculpt.') for name in sys.modules))\n"
    )
    assert int(run(code, tmp_path)) > 400


CHECKED = ("validate", "With warnings: A")
PLANNED = ("--nice 5 --dry-run render A", "To be done: simulating 2 frames")


def test_shots_are_checked_and_planned_where_modules_of_posix_are_missing(tmp_path: Path) -> None:
    asked = [PLANNED] if missing("authoring") else [CHECKED, PLANNED]
    shots = tmp_path / "shots"
    shots.mkdir()
    (shots / "A.yaml").write_text(SHOT, encoding="utf-8")
    code = (
        "from flowsculpt.pipeline.cli.app import main\n"
        "for line in sys.argv[1:]:\n"
        "    sys.argv = ['flowsculpt', *line.split()]\n"
        "    try:\n"
        "        main()\n"
        "    except SystemExit as end:\n"
        "        assert not end.code, line\n"
    )
    printed = run(code, tmp_path, *(line for line, _ in asked))
    assert [says for _, says in asked if says not in printed] == []
