"""Copies of a subject in mattes: told apart by the rays of the light, and merged from any batches."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flowsculpt.render.frame.accumulator import CopyCounts
from flowsculpt.render.frame.render_frame import render_frame
from flowsculpt.render.post.compositing import OBJECT, RankedCoverage, cryptomatte_layers
from flowsculpt.render.scene.aovs import COPY
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.scene import Scene, SceneSubject
from flowsculpt.render.scene.scene_lights import LIGHTS
from flowsculpt.render.scene.scene_stage import STAGES, StagePlacement
from flowsculpt.render.scene.surface import Surface
from tests.render.conftest import CAMERA, TINY
from tests.render.mattes import matte_of


def test_the_coverage_of_a_copy_is_that_of_a_subject_in_its_place(sphere, engine):
    if engine.variant == "scalar_rgb":
        pytest.skip("coverage is measured by the path tracer, which needs a compiled variant")
    a, b = (
        replace(sphere, vertices=sphere.vertices + np.float32([x, 0, 0]), rest=sphere.vertices)
        for x in (-0.8, 0.8)
    )
    numbers = np.repeat(np.float32([[1], [2]]), len(a.vertices), axis=0)
    faces = np.concatenate([a.faces, b.faces + len(a.vertices)]).astype(np.int32)
    joined = (np.concatenate([getattr(each, name) for each in (a, b)]) for name in ("vertices", "normals"))
    both = Surface(*joined, faces, {COPY: numbers})
    placed = LOOKS["clay"], LIGHTS["studio"], STAGES["cyclorama"], StagePlacement(), CAMERA
    other = (SceneSubject("heron", b, LOOKS["clay"]),)
    copies = render_frame(Scene(both, *placed), TINY, 3, engine)
    subjects = render_frame(Scene(a, *placed, others=other, name="crane"), TINY, 3, engine)
    ranks = np.moveaxis(np.concatenate([copies[f"copies{i:02d}"] for i in range(3)], axis=2), 2, 0)
    for number, name in ((1, "crane"), (2, "heron")):
        covered = (ranks[1::2] * (ranks[0::2] == number)).sum(axis=0)
        assert np.array_equal(covered, subjects[f"coverage.{name}"]), name
    assert np.array_equal(ranks[1::2].sum(axis=0), copies["coverage.subject"])
    assert subjects["coverage.heron"].max() == 1.0


SEEN = st.lists(st.lists(st.integers(0, 9), min_size=4, max_size=4), min_size=3, max_size=3)


@given(st.lists(SEEN, min_size=1, max_size=4))
def test_the_first_ranks_are_the_copies_that_most_samples_see(batches):
    counts = CopyCounts()
    for batch in batches:
        counts.add(np.array(batch, np.int32))
    counts = CopyCounts.restored(counts.state())
    samples = np.full((1, 3), 4 * len(batches))
    layers = counts.layers(samples)
    for pixel in range(3):
        seen = Counter(number for batch in batches for number in batch[pixel] if number)
        expected = sorted(seen.items(), key=lambda each: (-each[1], each[0]))[:6]
        found = np.concatenate([layers[f"copies{i:02d}"][0, pixel] for i in range(3)]).reshape(-1, 2)
        expected += [(0, 0)] * (6 - len(expected))
        assert np.allclose(found, [(number, count / (4 * len(batches))) for number, count in expected])


def test_copies_rank_among_other_objects_in_cryptomatte():
    numbers = np.array([[[2]], [[1]], [[0]]], np.float32)
    weights = np.array([[[0.5]], [[0.125]], [[0.0]]], np.float32)
    more = RankedCoverage(["pearl.1", "pearl.2"], numbers, weights)
    layers = cryptomatte_layers(OBJECT, {"stage": np.full((1, 1), 0.375, np.float32)}, more)
    covered = {name: float(matte_of(name, OBJECT, layers)[0, 0]) for name in ("stage", *more.names)}
    assert covered == {"stage": 0.375, "pearl.1": 0.125, "pearl.2": 0.5}
    assert layers["CryptoObject00"][0, 0, 1::2].tolist() == [0.5, 0.375]
