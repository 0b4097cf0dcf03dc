"""A film can stop at any frame and go on, bit for bit; nothing depends on the machine's threads."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.errors import FrameError, UsageError
from flowsculpt.pipeline.mesh import TriangleMesh, icosphere, validate
from flowsculpt.pipeline.resample import Exact, Resampler, Thresholds

THRESHOLDS = Thresholds(0.2)


def begin() -> Resampler:
    ball = icosphere(10)
    rest = {"rest": ball.vertices, "mark": np.arange(len(ball.vertices)) % 7, "heat": ball.vertices[:, 0]}
    return Resampler(TriangleMesh(ball.vertices, ball.faces, rest), THRESHOLDS)


def advance(resampler: Resampler, frames: range) -> None:
    for frame in frames:
        x, y, z = resampler.vertices.T.copy()
        resampler.vertices[:] = np.column_stack(
            [x + 0.06 * np.sin(2 * y + frame), y + 0.05 * np.sin(3 * z), z * 1.01]
        )
        resampler.resample()


def digest(resampler: Resampler) -> dict[str, bytes]:
    return {name: values.tobytes() for name, values in resampler.state().items()}


def test_resuming_from_a_saved_frame_gives_the_same_bits_as_never_stopping(tmp_path: Path) -> None:
    straight = begin()
    advance(straight, range(30))
    stopped = begin()
    advance(stopped, range(13))
    np.savez(tmp_path / "frame.0013.npz", **stopped.state())
    with np.load(tmp_path / "frame.0013.npz") as saved:
        resumed = Resampler.from_state(saved, THRESHOLDS)
    advance(resumed, range(13, 30))
    assert digest(resumed) == digest(straight)


def test_after_another_surface_at_rest_a_frame_has_the_same_bits_as_one_resumed() -> None:
    """On the new one faces look inwards; on the old one none did, and only changed faces were looked at."""
    placement = Exact(lambda rest: rest)
    straight = Resampler(icosphere(10), THRESHOLDS, placement)
    assert straight.resample().too_long == 0
    rest = straight.vertices + 0.06 * np.random.default_rng(1).normal(size=straight.vertices.shape)
    straight.set_attributes(rest=rest)
    resumed = Resampler.from_state(straight.state(), THRESHOLDS, placement)
    assert resumed.resample().flips == straight.resample().flips > 0
    assert digest(resumed) == digest(straight)


def test_a_state_without_faces_cannot_be_resumed() -> None:
    with pytest.raises(UsageError, match="has no faces"):
        Resampler.from_state({"vertices": np.eye(3)}, THRESHOLDS)


@pytest.mark.slow
def test_the_number_of_threads_does_not_change_a_bit() -> None:
    script = (
        "import hashlib, runpy;"
        f"t = runpy.run_path({__file__!r});"
        "r = t['begin'](); t['advance'](r, range(12));"
        "print(hashlib.sha256(b''.join(t['digest'](r).values())).hexdigest())"
    )
    answers = {
        subprocess.run(
            [sys.executable, "-c", script],
            env={"NUMBA_NUM_THREADS": str(threads), "HOME": str(Path.home()), "PYTHONPATH": str(Path.cwd())},
            check=True,
            capture_output=True,
            text=True,
        ).stdout
        for threads in (1, 4)
    }
    assert len(answers) == 1


def test_attributes_are_interpolated_on_the_way() -> None:
    """Attributes that are linear in space stay so, whatever is split or merged; marks are never mixed."""
    ball = icosphere(10)
    values = {"rest": ball.vertices, "mark": np.arange(len(ball.vertices)) % 7}
    resampler = Resampler(TriangleMesh(ball.vertices, ball.faces, values), THRESHOLDS)
    reports = []
    for _ in range(10):
        resampler.vertices[:] *= [1.2, 0.9, 0.9]
        reports.append(resampler.resample())
    assert sum(r.splits for r in reports) > 100
    assert sum(r.collapses for r in reports) > 100
    mesh = resampler.mesh
    assert np.allclose(mesh.attributes["rest"] * [1.2**10, 0.9**10, 0.9**10], mesh.vertices)
    assert mesh.attributes["mark"].dtype == values["mark"].dtype
    assert set(np.unique(mesh.attributes["mark"])) <= set(range(7))


def test_a_frame_over_the_budget_stops_and_leaves_the_surface_sound() -> None:
    resampler = Resampler(icosphere(6), Thresholds(0.3, max_vertices=5000))
    resampler.vertices[:] *= 100
    with pytest.raises(FrameError, match=r"exceeds the budget of 5000; raise max_vertices"):
        resampler.resample()
    assert validate(resampler.mesh).require(closed=True).euler == 2
    assert len(resampler.vertices) <= 5000


@pytest.mark.parametrize("wild", [np.nan, np.inf, 1e300])
def test_a_vertex_that_is_not_finite_stops_the_frame(wild: float) -> None:
    resampler = Resampler(icosphere(4), THRESHOLDS)
    resampler.vertices[17, 1] = wild
    with pytest.raises(FrameError, match=r"vertex 17 is at .*not finite"):
        resampler.resample()


def test_a_surface_within_its_length_limits_is_left_alone() -> None:
    resampler = begin()
    resampler.resample()
    before = digest(resampler)
    report = resampler.resample()
    assert (report.splits, report.collapses, report.flips, report.passes) == (0, 0, 0, 0)
    assert digest(resampler) == before
