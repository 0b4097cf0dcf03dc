"""Sums of sample batches, some of which are of some pixels only."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.render.frame.accumulator import Accumulator
from flowsculpt.render.scene.render_quality import Quality

WIDTH, HEIGHT = 6, 4
PIXELS = st.lists(st.integers(0, WIDTH * HEIGHT - 1), min_size=1, unique=True).map(sorted)


@settings(deadline=None)  # the first example loads a kernel
@given(batches=st.lists(st.tuples(PIXELS, st.sampled_from([1, 4, 8])), max_size=4), cut=st.integers(0, 3))
def test_each_pixel_is_the_mean_of_its_own_samples(batches: list[tuple[list[int], int]], cut: int) -> None:
    def accumulator() -> Accumulator:
        return Accumulator(Quality(WIDTH, HEIGHT, samples=64, depth=3), ("samples", "noise"))

    random = np.random.default_rng(5)
    whole = random.uniform(0.9, 1.0, (HEIGHT, WIDTH, 5))
    sums = accumulator()
    for name, channels in {"albedo": 3, "normal": 3, "position": 3, "depth": 1, "matte": 1}.items():
        sums.add(name, np.zeros((HEIGHT, WIDTH, channels)), 4)
    sums.add("beauty", whole, 4)
    total, count = 4 * whole.reshape(-1, 5), np.full(WIDTH * HEIGHT, 4)
    for number, (pixels, samples) in enumerate(batches):
        if number == cut:
            resumed = accumulator()
            resumed.restore(sums.state())
            sums = resumed
        means = random.uniform(0.9, 1.0, (len(pixels), 5))
        sums.add("beauty", means, samples, np.array(pixels))
        total[pixels] += samples * means
        count[pixels] += samples
    arrays = sums.frame_aovs()
    assert np.array_equal(arrays["samples"].ravel(), count)
    assert np.allclose(arrays["beauty"].reshape(-1, 3), total[:, :3] / count[:, None])
