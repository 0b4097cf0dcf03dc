from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import pytest

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.base.serialise import NOT_PLAIN, from_plain, named_by_kind, to_plain


@dataclass(frozen=True)
class Clip:
    path: Path
    frames: tuple[int, int]
    gain: float | None = None


@dataclass(frozen=True)
class Edit:
    clips: tuple[Clip, ...]
    digests: tuple[tuple[str, str], ...] = ()
    first: Clip | None = None
    by_number: Mapping[int, Clip] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    cache: object = field(default=None, compare=False, metadata=NOT_PLAIN)


CLIP = Clip(Path("shots/a.yaml"), (1, 48), 0.5)
EDIT = Edit((CLIP, Clip(Path("b"), (3, 4))), (("a", "1"),), CLIP, {3: CLIP}, ["one"], object())


def test_nested_dataclasses_come_back_from_json_as_they_were() -> None:
    again = from_plain(Edit, json.loads(json.dumps(to_plain(EDIT))))
    assert again == EDIT
    assert again.cache is None
    assert isinstance(again.clips[0].path, Path) and list(again.by_number) == [3]


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({}, "Edit: .*clips"),
        ({"clips": [], "takes": []}, "Edit has no 'takes'; it has clips, digests, "),
        ({"clips": [{"path": "a", "frames": [1]}]}, r"Edit\.clips\[0\]\.frames has 1 values; it needs 2"),
        ({"clips": [{"path": 1, "frames": [1, 2]}]}, r"Edit\.clips\[0\]\.path: "),
        ({"clips": 3}, r"Edit\.clips: "),
        ({"clips": [], "by_number": {"x": None}}, r"Edit\.by_number: "),
        ([], "Edit"),
        (3, "Edit"),
    ],
)
def test_values_of_another_shape_name_the_field(values: object, says: str) -> None:
    with pytest.raises(BadInputError, match=says):
        from_plain(Edit, values)


@dataclass(frozen=True)
class Still:
    kind: ClassVar[str] = ""


@dataclass(frozen=True)
class Pan:
    kind: ClassVar[str] = "pan"
    degrees: float = 0.0


@dataclass(frozen=True)
class Take:
    name: str
    move: Still | Pan = field(default=Still(), metadata=named_by_kind({"pan": Pan}.get))


def test_a_field_named_by_its_kind_comes_back_as_the_class_of_that_kind() -> None:
    assert to_plain(Take("a")) == {"name": "a"}
    assert to_plain(Take("a", Pan(3.0))) == {"name": "a", "pan": {"degrees": 3.0}}
    for take in (Take("a"), Take("a", Pan(3.0))):
        assert from_plain(Take, to_plain(take)) == take
    assert from_plain(Take, {"name": "a", "pan": None}) == Take("a")
    with pytest.raises(BadInputError, match="Take has no 'tilt'"):
        from_plain(Take, {"name": "a", "tilt": {}})
