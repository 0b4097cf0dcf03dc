"""Keys: the same content, the same key; anything else, another."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.production.store.store import key_of

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


def test_what_json_cannot_say_is_refused():
    with pytest.raises(ValueError):
        key_of(math.nan)
    with pytest.raises(TypeError):
        key_of(object())
