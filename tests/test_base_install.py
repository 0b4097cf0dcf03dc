"""The library in a process of somebody else: it needs few packages, and leaves the process as it is."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]

FILM = {
    *("OpenEXR", "OpenImageIO", "av", "drjit", "fileseq", "fontTools", "fsspec", "imageio", "matplotlib"),
    *("mitsuba", "oidn", "opentimelineio", "portalocker", "psutil", "pydantic", "rich", "ruamel", "shapely"),
    *("snakemake", "trimesh", "typer", "uharfbuzz"),
}
"""The packages of the extra `film`, by the names that they are imported by."""

BASE = f"import sys; sys.modules.update(dict.fromkeys({sorted(FILM)}))\n"
"""Makes a process one of a base install, where imports of these fail."""


def run(code: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run code in a process that is none of flowsculpt's own."""
    ours = ("FLOWSCULPT_", "NUMBA_", "OMP_")
    usual = {name: value for name, value in os.environ.items() if not name.startswith(ours)}
    words = [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(ROOT)!r})\n{code}"]
    return subprocess.run(words, cwd=folder, env=usual, capture_output=True, text=True)


def test_a_sphere_is_resampled_without_the_packages_of_films(tmp_path: Path) -> None:
    code = BASE + (
        "from flowsculpt import Resampler, Thresholds, icosphere\n"
        "sculpture = Resampler(icosphere(4), Thresholds(max_edge_length=0.3))\n"
        "sculpture.vertices[:, 0] *= 2\n"
        "sculpture.resample()\n"
        "print(len(sculpture.vertices))\n"
    )
    done = run(code, tmp_path)
    assert done.returncode == 0 and int(done.stdout) > 162, done.stderr


def test_importing_the_library_changes_nothing_in_the_process(tmp_path: Path) -> None:
    code = (
        "import os, warnings\n"
        "before = dict(os.environ), list(sys.path), list(warnings.filters)\n"
        "import flowsculpt\n"
        "assert not any(name.startswith(('flowsculpt.', 'numpy', 'numba')) for name in sys.modules)\n"
        "from flowsculpt import Resampler, Thresholds, icosphere\n"
        "assert (dict(os.environ), list(sys.path)) == before[:2]\n"
        "Resampler(icosphere(4), Thresholds(max_edge_length=0.3)).resample()\n"
        "import numba\n"
        "print((dict(os.environ), list(sys.path)) == before[:2], numba.config.CACHE_DIR == '')\n"
    )
    done = run(code, tmp_path)
    assert done.stdout == "True True\n", done.stderr


def test_the_command_of_a_library_says_what_to_install(tmp_path: Path) -> None:
    code = BASE + "from flowsculpt.__main__ import main; sys.argv = ['flowsculpt', 'film']; main()"
    done = run(code, tmp_path)
    assert done.returncode == 4 and done.stderr.count("\n") == 1
    assert "pip install 'flowsculpt[film]'" in done.stderr
