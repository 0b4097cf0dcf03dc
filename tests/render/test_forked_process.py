"""Forked processes: they end, print and heed signals as processes do that were started."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="only Linux forks safely")


def run(script: str, folder: Path) -> str:
    """Run a script in a process that has one thread, as that of a test need not; return what it prints."""
    words = [sys.executable, "-c", f"from flowsculpt.render.base.python_process import *\n{script}"]
    return subprocess.run(words, cwd=folder, check=True, capture_output=True, text=True, timeout=300).stdout


def test_a_forked_process_prints_to_its_file_in_its_folder_and_gives_its_exit_code(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    script = (
        "import sys\n"
        "def work():\n"
        "    print('made in', Path.cwd().name)\n"
        "    print('as told', file=sys.stderr)\n"
        "    return 3\n"
        "print('before')\n"
        "with open('log', 'w') as log:\n"
        "    print(ForkedProcess(work, log.fileno(), Path('folder')).wait())\n"
    )
    assert run(script, tmp_path) == "before\n3\n"
    assert (tmp_path / "log").read_text() == "made in folder\nas told\n"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_a_signal_ends_a_forked_process_though_its_parent_handles_it(number: int, tmp_path: Path) -> None:
    script = (
        "import time\n"
        "for each in (signal.SIGINT, signal.SIGTERM):\n"
        "    signal.signal(each, lambda *_: print('the parent'))\n"
        "process = ForkedProcess(lambda: time.sleep(60))\n"
        f"process.send_signal({int(number)})\n"
        "print(process.wait())\n"
    )
    assert run(script, tmp_path) == f"{-number}\n"


def test_only_a_process_with_one_thread_may_be_forked(tmp_path: Path) -> None:
    """Threads of OpenBLAS end before a fork; those that Python knows nothing of count too."""
    script = (
        "import numpy, time\n"
        "a = numpy.ones((500, 500)); a @ a\n"
        "print(any(ForkedProcess.may_start() for _ in range(1000)))\n"  # threads are listed a moment longer
        "import _thread\n"
        "_thread.start_new_thread(time.sleep, (60,))\n"
        "print(ForkedProcess.may_start())\n"
    )
    assert run(script, tmp_path) == "True\nFalse\n"
