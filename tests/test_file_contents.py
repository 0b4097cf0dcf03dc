"""Text in every encoding that is known is the same text."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flowsculpt.render.base.file_contents import as_utf8, number_fault, text_content

LETTERS = st.characters(exclude_categories=["Cs"])


@pytest.mark.parametrize(
    "encoding",
    ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32", "utf-32-le", "utf-32-be"],
)
@given(text=st.text(LETTERS), first=st.sampled_from(["v ", "ply", "#!", "t:"]))
def test_text_that_begins_with_ascii_is_known_in_every_encoding(encoding: str, text: str, first: str) -> None:
    assert as_utf8((first + text).encode(encoding)) == (first + text).encode()


@given(st.binary())
def test_other_bytes_are_kept_or_refused(content: bytes) -> None:
    try:
        read = as_utf8(b"\x80" + content)
    except ValueError as error:
        assert str(error).startswith("it begins as UTF-")
    else:
        assert read == b"\x80" + content


@given(st.lists(st.text("ab #", min_size=1)), st.sampled_from(["\n", "\r", "\r\n", "\n\r"]))
def test_lines_are_those_of_any_line_end(lines: list[str], line_end: str) -> None:
    assert text_content(line_end.join(lines).encode()).decode() == "\n".join(lines)


@pytest.mark.parametrize(
    ("word", "fault"),
    [
        (b"1.5", ""),
        (b"1e5D3", "1e5D3 is not a number"),
        (b"-0,5e3", "-0,5e3 is not a number; decimals have a point, as in -0.5e3"),
        (b"\xe4", "\N{REPLACEMENT CHARACTER} is not a number"),
    ],
)
def test_a_word_that_is_not_a_number_is_named(word: bytes, fault: str) -> None:
    assert number_fault([b"0", word]) == fault
