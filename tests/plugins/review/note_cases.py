"""Notes for tests: one by hand, and strategies of collections whose notes share ids and times."""

from __future__ import annotations

from typing import Any

from hypothesis import strategies as st

from flowsculpt.pipeline.plugins.review.review_notes import FORMAT, VERSION

ATTACK = "<img src=x onerror='window.attacked = 1'><script>window.attacked = 1</script>"
TIMES = [f"2026-11-2{day}T09:00:00.{part}Z" for day in (1, 2) for part in ("000", "001")]
IDS = [f"{digit * 8}-0000-4000-8000-{'0' * 12}" for digit in "abc"]
WORDS = ["", "softer", "Größe 𝛼\n\ttwo", '<img src=x onerror="window.attacked = 1">', "\uffee \\u2028 '\""]


def stroke(**fields: Any) -> dict[str, Any]:
    plain = {"frame": 3, "kind": "pen", "ink": "#ffb000", "width": 24, "points": [1, 2, 3, 4], "text": ""}
    return {**plain, **fields}


def revision(**fields: Any) -> dict[str, Any]:
    """What a note says, with defaults for all that is not given."""
    return {
        "shot": "T010_tiny",
        "sequence": "draft",
        "picture": "",
        "first": 3,
        "last": 5,
        "status": "open",
        "text": "softer",
        "drawings": [stroke()],
        "author": "Ann",
        "created": TIMES[0],
        "modified": TIMES[1],
        "deleted": False,
        **fields,
    }


def note(**fields: Any) -> dict[str, Any]:
    return {"id": IDS[0], **revision(), "history": [], **fields}


def document(*notes: dict[str, Any], **fields: Any) -> dict[str, Any]:
    """The content of a file of notes."""
    return {"format": FORMAT, "version": VERSION, "notes": list(notes), **fields}


def _revisions() -> st.SearchStrategy[dict[str, Any]]:
    return st.builds(
        revision,
        text=st.sampled_from(WORDS),
        status=st.sampled_from(["open", "change", "approved"]),
        modified=st.sampled_from(TIMES),
        created=st.sampled_from(TIMES[:2]),
        deleted=st.booleans(),
        drawings=st.lists(st.builds(stroke, frame=st.integers(-3, 3)), max_size=2),
    )


def _note(name: str, latest: dict[str, Any], history: list[dict[str, Any]]) -> dict[str, Any]:
    return {"id": name, **latest, "history": history}


NOTES = st.lists(
    st.builds(_note, st.sampled_from(IDS), _revisions(), st.lists(_revisions(), max_size=2)), max_size=4
)
"""Collections of notes as files hold them; the order of their revisions is as it comes."""
