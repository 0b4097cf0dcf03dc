"""JSON that is kept between runs is used where it is what its reader expects, and else counts as none."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from flowsculpt.render.base.state_files import mapping, read_state
from flowsculpt.render.base.user_cache import CachedAnswer

pytestmark = pytest.mark.quick


def test_what_was_written_is_read(tmp_path: Path) -> None:
    path = tmp_path / "answer.json"
    CachedAnswer(path).store({"works": True, "é": [1, 2.5, None]})
    assert CachedAnswer(path).load(lambda answer: answer["é"]) == [1, 2.5, None]
    path.write_text(json.dumps({"a": 1}))
    assert read_state(path, numbers) == {"a": 1}


def numbers(data: dict[str, object]) -> dict[str, int]:
    return {name: int(str(number)) for name, number in mapping(data).items()}


@pytest.mark.parametrize(
    "content",
    [
        *(
            "",
            "[]",
            "null",
            '"x"',
            "7" * 400,
            '{"a": %s}' % ("7" * 5000),
            "[" * 100_000,
            '{"a": 1',
            '{"a": "x"}',
        ),
        *('{"a": NaN}', '{"a": -Infinity}', '{"a": 1e999}', '{"a": [1]}', '{"a": null}', '{"a": 1} {}'),
    ],
)
def test_what_no_run_has_written_counts_as_none(tmp_path: Path, content: str) -> None:
    path = tmp_path / "state.json"
    path.write_text(content)
    assert read_state(path, numbers) is None


def test_files_that_cannot_be_read_count_as_none(tmp_path: Path) -> None:
    (tmp_path / "binary").write_bytes(b"\xff\xfe\x00{")
    for path in (tmp_path, tmp_path / "missing", tmp_path / "binary", tmp_path / "binary" / "below"):
        assert read_state(path, mapping) is None
