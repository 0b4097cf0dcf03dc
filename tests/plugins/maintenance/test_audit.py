"""`audit` makes random finished frames again, and finds every value that another hand has changed."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.plugins.maintenance import audit_command
from flowsculpt.pipeline.plugins.maintenance.audit_command import Audit, difference
from flowsculpt.pipeline.production.request.keys import FrameKeys
from flowsculpt.pipeline.production.store.locks import Locks
from flowsculpt.render.post.image import read_exr, write_exr
from flowsculpt.render.scene.aovs import RenderedFrame
from tests.conftest import QUALITY, ProjectFolder

NAME = "T010_tiny"


def one_bit_apart(path: Path) -> None:
    """Write a picture again with one bit of one value changed, and the header that it had."""
    layers, header = read_exr(path)
    beauty = np.array(layers["beauty"])
    beauty[3, 5, 1] = np.nextafter(beauty[3, 5, 1].astype(np.float16), np.float16(9.0))
    path.chmod(0o644)
    path.unlink()
    write_exr(path, RenderedFrame({**layers.arrays, "beauty": beauty}), header)


def test_frames_made_again_have_the_same_bits_but_the_one_of_which_a_bit_was_changed(
    finished: ProjectFolder,
) -> None:
    shown = finished.path / f"renders/{NAME}/{QUALITY}/frames/{NAME}.0002.exr"
    key = read_exr(shown)[1]["key"]
    one_bit_apart(next((finished.path / ".flowsculpt/store/frame").glob(f"*/{key}.exr")))
    with Locks(finished.path).hold({Locks.name(f"audit/{NAME}", QUALITY): "the audit"}):
        refused = finished.call("audit", NAME, "-q", QUALITY)
    assert refused.code == 4 and "another flowsculpt run is making it" in refused.err
    done = finished.run("--json", "audit", NAME, "-q", QUALITY, "--share", "100%", "-f", "1-2")
    assert done.code == 1, done.err
    facts = json.loads(done.out)
    same, altered = facts["frames"]
    assert same == {"frame": 1, "same": True, "difference": ""} and not facts["same"]
    assert altered["difference"].startswith("beauty differs in 0.02% of its pixels, by up to")
    assert (finished.path / ".flowsculpt/audit" / f"{NAME}.{QUALITY}").exists()


def test_chance_chooses_a_share_of_the_frames_the_same_for_the_same_seed() -> None:
    frames = {number: FrameKeys("", f"{number:032x}", (number,), {}) for number in range(1, 251)}
    audit = Audit(None, None, frames)  # type: ignore[arg-type]  # neither is asked
    chosen = audit.chosen(0.01, 0)
    assert len(chosen) == 3 and chosen == sorted(set(chosen)) == audit.chosen(0.01, 0)
    assert chosen != audit.chosen(0.01, 1)
    assert audit.chosen(1.0, 5) == list(frames)
    assert len(Audit(None, None, {7: frames[7]}).chosen(0.001, 0)) == 1  # type: ignore[arg-type]


@pytest.mark.parametrize("text", ["0", "101%", "some", "-3%", "nan"])
def test_a_share_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="not a share"):
        audit_command._share(text)


def test_layers_that_only_one_picture_has_and_files_that_are_none_count_as_different(tmp_path: Path) -> None:
    layers = {"beauty": np.zeros((2, 3, 3), np.float16), "matte": np.zeros((2, 3, 1), np.float16)}
    one, other = tmp_path / "1.exr", tmp_path / "2.exr"
    write_exr(one, RenderedFrame(layers), {"key": "a"})
    write_exr(other, RenderedFrame({"beauty": layers["beauty"]}), {"key": "b"})
    assert difference(one, one) == ""
    assert difference(one, other) == "has other layers: matte in one of the two"
    other.write_bytes(b"nothing")
    assert difference(one, other).startswith("cannot be read")


def test_a_shot_without_finished_frames_says_which_command_makes_them(project: ProjectFolder) -> None:
    done = project.call("audit", NAME, "-q", QUALITY)
    assert done.code == 3 and f"flowsculpt render {NAME} -q {QUALITY}" in done.err
