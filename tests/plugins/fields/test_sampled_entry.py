"""The entry `sampled` of shot files: what can be said, and how what is wrong is told, with its place."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.errors import MissingInputError, ShotError
from flowsculpt.pipeline.flow import Sequence, Streamlines
from flowsculpt.pipeline.flow.catalogue.sampled_field import Sampled
from flowsculpt.pipeline.shot import Shot, read_shot

HEAD = "title: T\nframes: 1-24\nsubject: {solid: icosphere}\nresample: off\nflows:\n"
GRID = np.linspace(-1, 1, 3)


def save(file: Path, value: float) -> None:
    np.savez(file, x=GRID, y=GRID, z=GRID, velocity=np.full((3, 3, 3, 3), value))


def shot_of(folder: Path, *flows: str) -> Shot:
    return read_shot(folder / "a.yaml", HEAD + "".join(f"  - {flow}\n" for flow in flows))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    save(tmp_path / "w_01.npz", 1.0)
    save(tmp_path / "w_02.npz", 0.0)
    save(tmp_path / "fast.npz", 1e200)
    (tmp_path / "a.yaml").touch()
    np.savez(tmp_path / "bad.npz", x=GRID, z=GRID, velocity=np.ones((3, 3, 3, 3)))
    return tmp_path


def test_one_file_or_a_sequence_can_be_written(folder: Path) -> None:
    shot = shot_of(
        folder,
        "sampled: {file: w_01.npz, between: cubic, outside: zero}",
        "sampled: {file: w_*.npz, interval: 0.5, loop: true}",
    )
    assert isinstance(shot.motion.flow, Sequence)
    one, sequence = (flow.field for flow in shot.motion.flow.flows if isinstance(flow, Streamlines))
    assert isinstance(one, Sampled) and one.between == "cubic"
    assert isinstance(sequence, Sampled) and sequence.samples.times.tolist() == [0.0, 0.5]


WRONG = [
    (
        "sampled: {file: w_01.npz, array: u}",
        "array u does not apply; in .npz the array is velocity. Leave out array.",
    ),
    ("sampled: {file: fast.npz}", "is 1e+200; samples must be finite, and at most 1e12."),
    ("sampled: {file: gone.vti}", "file gone.vti is not there"),
    ("sampled: {file: gone_*.vti}", "no file matches gone_*.vti"),
    ("sampled: {file: a.yaml}", ".yaml is not a format of fields"),
    ("sampled: {file: bad.npz}", "array y is missing"),
    ("sampled: {file: w_01.npz, outside: mirror}", "it must be 'clamp', 'zero' or 'repeat'"),
    (
        "sampled: {file: /proc/self/me*}",
        "/proc/self/mem: no suffix is not a format of fields; use .vti, .vtr, ",
    ),
    (f"sampled: {{file: {'n' * 5000}.npz}}", "file nnnn"),
    ("sampled: {file: '**.npz'}", "file **.npz is not a name of a sequence; each * stands for any letters"),
    ("sampled: {file: '._*.npz'}", "no file matches ._*.npz"),
]


@pytest.mark.parametrize(("flow", "says"), WRONG, ids=[flow[:60] for flow, _ in WRONG])
def test_what_is_wrong_is_told_in_one_line_with_its_place(flow: str, says: str, folder: Path) -> None:
    (folder / "._w.npz").touch()  # of macOS
    with pytest.raises((ShotError, MissingInputError)) as told:
        shot_of(folder, flow)
    message = str(told.value)
    assert says in message, message
    assert message.startswith(f"{folder / 'a.yaml'}:6:") and message.isprintable() and len(message) < 700


def test_contents_of_files_decide_and_not_their_names(folder: Path) -> None:
    before = shot_of(folder, "sampled: {file: w_01.npz}").motion.step_data(5)
    (folder / "w_03.npz").write_bytes((folder / "w_01.npz").read_bytes())
    assert shot_of(folder, "sampled: {file: w_03.npz}").motion.step_data(5) == before
    assert shot_of(folder, "sampled: {file: w_02.npz}").motion.step_data(5) != before
