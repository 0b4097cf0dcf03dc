"""Colours in shot files: three linear numbers, or sRGB in quotes, wherever a colour stands."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flowsculpt.pipeline.shot import read_shot
from flowsculpt.pipeline.shot.documents import (
    camera_documents,
    flow_entries,
    light_documents,
    look_documents,
    look_parts,
    resampling,
    shot_documents,
    subject_documents,
)
from flowsculpt.pipeline.shot.documents.field_types import Document, linear_of_hex

TEXT = "title: A\nframes: 1-2\nsubject: {solid: box}\nresample: off\n"


def picture(entry: str) -> object:
    return read_shot(Path("/nowhere/a.yaml"), TEXT + entry).picture


@given(st.integers(0, 0xFFFFFF))
def test_a_colour_of_srgb_is_decoded_by_its_standard(value: int) -> None:
    text = f"#{value:06x}"
    linear = linear_of_hex(text)
    assert linear == linear_of_hex(text.upper()) and all(0.0 <= part <= 1.0 for part in linear)
    encoded = [part * 12.92 if part <= 0.0031308 else 1.055 * part ** (1 / 2.4) - 0.055 for part in linear]
    assert sum(round(255 * part) << shift for part, shift in zip(encoded, (16, 8, 0), strict=True)) == value


@pytest.mark.parametrize(
    "entry",
    [
        "look: {material: clay, colour: %s}",
        "look: {material: cream, pigment: {layers: {colours: [%s, [0, 0, 0]]}}}",
        "look: {material: glass, absorption: {colour: %s}}",
        "look: {material: clay, wireframe: {colour: %s}}",
        "look: {bsdf: {type: diffuse, reflectance: %s}}",
        "lights: {sky: {zenith: %s}}",
        "lights: {softboxes: [{position: [0, 3, 3], radiance: %s}]}",
        "stage: {kind: ground, colour: %s}",
    ],
)
def test_a_colour_of_srgb_is_the_same_as_its_linear_numbers(entry: str) -> None:
    numbers = str(linear_of_hex("#cc4422"))
    assert picture(entry % "'#cc4422'") == picture(entry % "'#c42'") == picture(entry % numbers)


def test_the_examples_of_messages_are_what_a_shot_can_have() -> None:
    from ruamel.yaml import YAML

    modules = (
        camera_documents,
        flow_entries,
        light_documents,
        look_documents,
        look_parts,
        resampling,
        shot_documents,
        subject_documents,
    )
    documents = {each for module in modules for each in vars(module).values() if isinstance(each, type)}
    with_example = [each for each in documents if issubclass(each, Document) and each.example]
    assert len(with_example) > 12
    for document in with_example:
        document.model_validate(YAML(typ="safe").load(document.example))
