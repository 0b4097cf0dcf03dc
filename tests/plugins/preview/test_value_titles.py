"""Values have names that people know them by, whatever their flows are composed of."""

from __future__ import annotations

import pytest

from flowsculpt.pipeline.plugins.preview.text_edits import Where
from flowsculpt.pipeline.plugins.preview.value_titles import value_title


@pytest.mark.parametrize(
    ("where", "group", "title", "note", "name", "words"),
    [
        (("camera", "azimuth"), "camera", "camera", "", "azimuth", "camera azimuth"),
        (("speed",), "speed", "speed", "", "speed", "speed"),
        (("resample", "max_edge_length"), "resample", "resampling", "", "max edge length", None),
        (("flows", 0, "vortex", "strength"), "flows.0.vortex", "vortex", "flow 0", "strength", None),
        (
            *(("flows", 1, "within", "flows", 0, "curl_noise", "scale"), "flows.1.within.flows.0.curl_noise"),
            *("curl noise", "flow 1.0, in within", "scale", "curl noise 1.0 scale"),
        ),
        (
            *(("flows", 1, "within", "region", "radius"), "flows.1.within", "within", "flow 1"),
            *("region › radius", "within 1 region radius"),
        ),
        (("subjects", "ball_2", "size"), "subjects.ball_2", "ball 2", "subject", "size", "ball 2 size"),
        (
            *(("subjects", "ball", "flows", 0, "twist", "angle"), "subjects.ball.flows.0.twist"),
            *("twist", "flow 0, of ball", "angle", "twist 0 angle"),
        ),
    ],
)
def test_a_value_is_named_by_its_flow_or_entry(
    where: Where, group: str, title: str, note: str, name: str, words: str | None
) -> None:
    found = value_title(where)
    assert found[:4] == (group, title, note, name)
    assert found.words == (words or found.words) and found.is_flow == ("flows" in where)
