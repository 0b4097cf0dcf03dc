"""Streams that meshoptimizer wrote, in `meshopt_streams.json`, are decoded to the same bytes as it does."""

from __future__ import annotations

import base64
import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.arrays import AnyArray
from flowsculpt.pipeline.plugins.interchange.meshopt import FILTERS, MODES

STREAMS: dict[str, dict[str, Any]] = {
    stream["name"]: stream | {"encoded": base64.b64decode(stream["encoded"])}
    for stream in json.loads(Path(__file__).with_name("meshopt_streams.json").read_text())
}


def decoded(stream: dict[str, Any], content: bytes) -> AnyArray:
    elements = MODES[stream["mode"]](content, stream["count"], stream["stride"])
    return FILTERS[stream["filter"]](elements)


@pytest.mark.parametrize("name", STREAMS)
def test_a_stream_is_decoded_to_the_bytes_of_the_reference(name: str) -> None:
    stream = STREAMS[name]
    content = np.ascontiguousarray(decoded(stream, stream["encoded"])).tobytes()
    assert len(content) == stream["count"] * stream["stride"]
    assert hashlib.sha256(content).hexdigest() == stream["sha256"]


@pytest.mark.parametrize("name", STREAMS)
def test_a_stream_that_is_cut_or_too_long_is_refused(name: str) -> None:
    stream = STREAMS[name]
    for content in (stream["encoded"][:-5], stream["encoded"][:20], stream["encoded"][:1], b""):
        with pytest.raises(
            ValueError, match=r"ends early|left over|begin like|mode|before there is|over 5 bytes"
        ):
            decoded(stream, content)


@settings(max_examples=300, deadline=None)
@given(st.sampled_from(sorted(STREAMS)), st.integers(0, 10**6), st.integers(0, 255), st.integers(0, 3))
def test_a_damaged_stream_is_decoded_or_refused(name: str, at: int, byte: int, longer: int) -> None:
    stream = STREAMS[name]
    content = bytearray(stream["encoded"])
    content[at % len(content)] = byte
    try:
        elements = decoded(stream | {"count": stream["count"] + 3 * longer}, bytes(content))
    except ValueError:
        return
    assert elements.nbytes == (stream["count"] + 3 * longer) * stream["stride"]
