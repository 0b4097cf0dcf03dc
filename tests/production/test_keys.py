"""Keys: the same content, the same key; anything else, another."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flowsculpt.pipeline.flow import Flow
from flowsculpt.pipeline.production.request.manifest import mesh_keys
from flowsculpt.pipeline.production.store.store import key_of
from flowsculpt.pipeline.shot import read_shot

pytestmark = pytest.mark.quick

plain = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)


@given(st.dictionaries(st.text(), plain, max_size=5))
def test_the_order_of_a_mapping_is_no_content(data):
    assert key_of(data) == key_of(dict(reversed(data.items())))


@given(plain, plain)
def test_parts_do_not_run_into_one_another(a, b):
    assert key_of([a, b]) != key_of(a, b)


def test_the_last_bit_of_a_number_is_content():
    assert key_of(0.05) != key_of(math.nextafter(0.05, 1))


class Lost(Flow):
    """A flow whose data are not numbers from the third frame on."""

    def displace(self, points, time, dt):
        return points

    def cache_data(self, time, dt):
        return [time if time < 0.05 else math.nan, dt]


def test_frames_whose_flow_is_not_finite_have_keys_all_the_same(tmp_path):
    shot = tmp_path / "a.yaml"
    shot.write_text("title: A\nframes: 1-5\nsubject: {solid: box}\nresample: off\nflows: []\n")
    motion = replace(read_shot(shot).motion, flow=Lost())
    keys = mesh_keys(motion)
    assert [key_of(keys[n - 1], motion.step_data(n)) for n in range(2, 6)] == [keys[n] for n in range(2, 6)]


def test_what_json_cannot_say_is_refused():
    with pytest.raises(ValueError):
        key_of(math.nan)
    with pytest.raises(TypeError):
        key_of(object())
