"""The examples of docs/choreography.md are good, and its words are those of the code."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from flowsculpt.pipeline.flow import EASINGS
from flowsculpt.pipeline.flow.regions import FALLOFF_TYPES
from flowsculpt.pipeline.shot import read_shot
from flowsculpt.pipeline.shot.documents.flow_entries import FlowDocument, RegionDocument
from tests.needed_plugins import shot_rows

PROJECT = Path(__file__).parents[2]
PAGE = (PROJECT / "docs" / "choreography.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)
HEAD = "title: Page\nframes: 1-96\nsubject: {solid: box}\nresample: {max_edge_length: 0.25}\n"


@pytest.mark.parametrize("example", shot_rows(EXAMPLES), ids=range(len(EXAMPLES)))
def test_an_example_of_the_page_is_a_good_shot(example: str) -> None:
    text = example if example.startswith("title:") else HEAD + example
    shot = read_shot(PROJECT / "shots" / "page.yaml", text)
    moving = [part.motion for part in shot.parts if part.motion.flow.members]
    assert moving and all(motion.step_data(number) for motion in moving for number in (2, 50, 96))


def test_the_page_names_what_there_is() -> None:
    words = set(re.findall(r"`(\w+)`", PAGE))
    families = {name.rsplit("_in", 1)[0].removesuffix("_out") for name in EASINGS}
    compositions = {"sequence", "sum", "within", "blend", "placed", "mirrored", "reversed", "repeated"}
    assert families | compositions | set(RegionDocument.several) | set(FALLOFF_TYPES) | {"bezier"} <= words
    assert compositions <= set(FlowDocument.model_fields)
