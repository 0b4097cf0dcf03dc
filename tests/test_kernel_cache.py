"""Compiled kernels: made at set-up, never while somebody waits."""

import subprocess
import sys

from pipeline import kernels

SCENE = """
from pathlib import Path
from pipeline import kernels
from pipeline.animation import animate
from pipeline.mesh import split_at_creases
from pipeline.shot import read_shot

shot = read_shot(Path({path!r}))
for frame in animate(shot):
    split_at_creases(frame.mesh)
for dispatcher, signature in kernels.DECLARED:
    if len(dispatcher.signatures) > 1:
        print(dispatcher.__name__, dispatcher.signatures)
    if dispatcher.stats.cache_misses:
        print(dispatcher.__name__, "was compiled")
"""


def test_a_whole_shot_runs_on_what_set_up_has_compiled(studio):
    assert kernels.compile_all() > 0
    scene = SCENE.format(path=str(studio.shot))
    done = subprocess.run([sys.executable, "-c", scene], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert done.stdout == ""


def test_kernels_live_in_a_folder_named_by_their_sources(tmp_path, monkeypatch):
    before = kernels.cache_folder()
    edited = tmp_path / "pipeline" / "_kernels_edited.py"
    edited.parent.mkdir()
    edited.write_text("# another source")
    monkeypatch.setattr(kernels, "_PACKAGE", edited.parent)
    kernels.cache_folder.cache_clear()
    try:
        assert kernels.cache_folder() != before
    finally:
        kernels.cache_folder.cache_clear()
