"""The entry `picture` of a shot or an edit: the shape of its pictures."""

import math
import re
from typing import Annotated, Any, Self

from pydantic import BeforeValidator, Field, model_validator

from pipeline.errors import shortened
from pipeline.shot.documents.fields import Document, SchemaKeywords, is_number, optional
from pipeline.shot.yaml.plain_text import in_yaml
from pipeline.shot.yaml.validation import bad_value, finding
from render.scene.quality import even, final_size

NARROWEST, WIDEST = 0.2, 5.0
"""Limits of an aspect: automatic framing and the stages are made for these."""

SMALLEST, LARGEST = 64, 16384
"""Limits of a side of `final`, pixels: H.264 and H.265 go no further."""

_RATIO = re.compile(r"\s*(\d+(?:\.\d*)?|\.\d+)\s*(?:[:/]\s*(\d+(?:\.\d*)?|\.\d+)\s*)?")
_PIXELS = re.compile(r"\s*(\d+)\s*[x×*]\s*(\d+)\s*")
_USUAL = 'Write "9:16", "1:1" or 2.39.'


def _aspect(value: Any) -> Any:
    """Parse `9:16`, `9/16` or a number as width over height."""
    if isinstance(value, str) and (match := _RATIO.fullmatch(value)):
        width, height = float(match[1]), float(match[2] or 1.0)
        value = width / height if height else math.inf  # out of range
    elif isinstance(value, str) and (match := _PIXELS.fullmatch(value)):
        raise bad_value(f"these are pixels. Write size: [{match[1]}, {match[2]}] in place of aspect.")
    elif isinstance(value, list) and len(value) == 2 and all(is_number(each) and each > 0 for each in value):
        if min(value) >= SMALLEST:
            raise bad_value(f"these are pixels. Write size: {in_yaml(value)} in place of aspect.")
        raise bad_value(f'aspect is one value. Write "{value[0]}:{value[1]}".')
    elif not is_number(value):
        raise bad_value(f"{shortened(in_yaml(value))} is not an aspect, width to height. {_USUAL}")
    if not NARROWEST <= value <= WIDEST:
        raise bad_value(f"{value:.4g} is out of range, 1:5 to 5:1. {_USUAL}")
    return float(value)


def _size(value: Any) -> Any:
    """Refuse what is not an even width and height, with one that is."""
    if isinstance(value, str) and (match := _PIXELS.fullmatch(value)):
        raise bad_value(f"a size is a list. Write [{match[1]}, {match[2]}].")
    if not (isinstance(value, list) and len(value) == 2 and all(map(is_number, value))):
        raise bad_value(
            f"{shortened(in_yaml(value))} is not a size, width and height in pixels. Write [1080, 1920]."
        )
    if not all(SMALLEST <= side <= LARGEST for side in value):
        raise bad_value(
            f"{in_yaml(value)} is out of range, {SMALLEST} to {LARGEST} pixels a side. Write [1080, 1920]."
        )
    if any(side % 2 for side in value):
        raise bad_value(
            f"{in_yaml(value)} is not even, and movies need even sides. Write {list(map(even, value))}."
        )
    width, height = map(int, value)
    if not NARROWEST <= width / height <= WIDEST:
        raise bad_value(f"[{width}, {height}] is out of range, 1:5 to 5:1. Write [1080, 1920].")
    return [width, height]


Aspect = Annotated[
    Any,
    BeforeValidator(_aspect),
    SchemaKeywords(
        anyOf=[
            {"type": "number", "minimum": NARROWEST, "maximum": WIDEST},
            {"type": "string", "pattern": f"^{_RATIO.pattern}$"},
        ]
    ),
]
Side = Annotated[int, Field(ge=SMALLEST, le=LARGEST), SchemaKeywords(multipleOf=2)]
Size = Annotated[list[Side], BeforeValidator(_size), Field(min_length=2, max_length=2)]


class PictureShapeDocument(Document):
    """The shape of all pictures of a shot, or of an edit: an aspect, or the pixels of `final`."""

    example = '{aspect: "9:16"}'

    aspect: Aspect | None = optional(
        'width to height, such as "9:16" or 2.39; the shorter side stays 270, 540 or 1080 pixels'
    )
    size: Size | None = optional(
        "width and height in `final`, even numbers; `daily` has half of them, `draft` a quarter (pixels)"
    )

    @model_validator(mode="before")
    @classmethod
    def _is_a_mapping(cls, value: Any) -> Any:
        """Refuse a bare shape, with the name that it needs."""
        if isinstance(value, str | list) or is_number(value):
            is_ratio = is_number(value) or (isinstance(value, str) and _RATIO.fullmatch(value))
            pixels = list(map(int, re.findall(r"\d{2,}", in_yaml(value))))
            size = {"size": pixels} if len(pixels) == 2 else {"aspect": "9:16"}
            shape = {"aspect": value} if is_ratio else size
            raise finding(f"picture must be a mapping. Write picture: {in_yaml(shape)}.")
        return value

    @model_validator(mode="after")
    def _has_one(self) -> Self:
        if self.aspect is not None and self.size is not None:
            raise finding("picture has both aspect and size, and a size has an aspect. Remove one of them.")
        return self

    @property
    def final(self) -> tuple[int, int] | None:
        """Width and height of pictures of `final`, pixels; None for the usual ones."""
        if self.size is not None:
            width, height = self.size
            return width, height
        return None if self.aspect is None else final_size(self.aspect)
