"""All that changes over time in a shot is found, by its name and in its unit."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.plugins.review.keyed_curves import KeyedCurve, curves_of
from tests.conftest import lines
from tests.needed_plugins import needs_plugins

NAME = "T010_tiny"

SHOT = """\
title: C
frames: 1-25
subject: {solid: box}
resample: {max_edge_length: {keys: {1: 0.5, 25: 0.3}}, hard_angle: {ease: linear, keys: {1: 30, 25: 60}}}
flows:
  - sum:
      - rotation: {speed: {ease: linear, keys: {1: 0, 13: 90, "1s": 0}}}
      - vortex: {centre: {formula: [cos(t), "0", frame]}, strength: 2}
  - within:
      region: {sphere: {radius: {keys: {1: 1, 25: 2}}}, falloff: 0.5}
      flows: [{twist: {amount: {keys: {5: 0, 20: {value: 90, ease: constant}, 25: 60}}}}]
  - formula: {velocity: [k, 0, 0], with: {k: {keys: {1: 0, 25: 1}}}}
camera: {azimuth: {keys: {1: 0, 25: 40}}}
"""


def found(folder: Path, text: str = SHOT) -> dict[str, KeyedCurve]:
    (folder / "a.yaml").write_text(text)
    return {curve.name: curve for curve in curves_of(folder / "a.yaml")}


@needs_plugins("fields")
def test_curves_have_their_names_and_units_in_the_order_of_the_file(tmp_path: Path) -> None:
    assert {name: curve.unit for name, curve in found(tmp_path).items()} == {
        "resample.max_edge_length": "units",
        "resample.hard_angle": "degrees",
        "flows.0.sum.0.rotation.speed": "degrees/s",
        "flows.0.sum.1.vortex.centre": "units",
        "flows.1.within.region.sphere.radius": "units",
        "flows.1.within.flows.0.twist.amount": "degrees/unit",
        "flows.2.formula.with.k": "",
        "camera.azimuth": "degrees",
    }


@needs_plugins("fields")
def test_values_are_those_of_the_file_and_keys_lie_on_them(tmp_path: Path) -> None:
    curves = found(tmp_path)
    speed = curves["flows.0.sum.0.rotation.speed"]
    np.testing.assert_allclose(speed.keys, [(1, 0), (13, 90), (25, 0)], atol=1e-9)
    np.testing.assert_allclose(speed.values[speed.frames == 7.0], 45.0)
    centre = curves["flows.0.sum.1.vortex.centre"]
    assert centre.values.shape == (len(centre.frames), 3) and not len(centre.keys)
    np.testing.assert_allclose(centre.values[:, 2], centre.frames)
    amount = curves["flows.1.within.flows.0.twist.amount"]
    assert set(amount.values[(amount.frames > 20) & (amount.frames < 25), 0]) == {90.0}
    for curve in curves.values():
        for frame, *values in curve.keys:
            nearest = np.abs(curve.frames - frame).argmin()
            np.testing.assert_allclose(curve.values[nearest], values, atol=1e-6)


@needs_plugins("fields")
def test_what_the_speed_re_times_is_shown_at_the_frames_where_it_happens(tmp_path: Path) -> None:
    """At twice the speed the key of frame 13 is reached at frame 7; what has no time left is not reached."""
    text = SHOT.replace("camera:", "speed: 2\ncamera:")
    curves = found(tmp_path, text)
    speed = curves["flows.0.sum.0.rotation.speed"]
    np.testing.assert_allclose(speed.keys, [(1, 0), (7, 90), (13, 0)], atol=1e-6)
    np.testing.assert_allclose(curves["camera.azimuth"].keys, [(1, 0), (25, 40)], atol=1e-6)
    slow = found(tmp_path, SHOT.replace("camera:", "speed: 0.25\ncamera:"))["flows.0.sum.0.rotation.speed"]
    np.testing.assert_allclose(slow.keys, [(1, 0)], atol=1e-6)


@needs_plugins("fields")
@pytest.mark.parametrize("still", ["speed: 0\n", "speed: {keys: {1: 1, 25: 0}}\n"])
def test_a_flow_that_stands_still_has_curves_too(still: str, tmp_path: Path) -> None:
    curves = found(tmp_path, SHOT.replace("camera:", still + "camera:"))
    assert np.isfinite(curves["flows.0.sum.0.rotation.speed"].values).all()


def test_curves_are_drawn_to_a_page(project):
    done = project.call("--json", "curves", NAME)
    assert done.code == 0, done.err
    facts = json.loads(done.out)
    assert facts["curves"] == ["flows.0.twist.amount"]
    assert Path(facts["path"]).read_text().startswith("<?xml")
    for words, says in (
        (("--set", "flows.0.twist.amount=2"), "nothing that changes over time"),
        (("-o", "page.txt"), ".svg, .png, .pdf"),
    ):
        bad = project.call("curves", NAME, *words)
        assert bad.code == 2 and says in bad.err and len(lines(bad.err)) == 1
