"""Dissolves show two clips through one another, and hold no more than what is shown."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from flowsculpt.render.movie.movie_frames import dissolve, mix_frames

Shown = dict[str, float]


def clip(name: str, count: int) -> Iterator[Shown]:
    for number in range(count):
        yield {f"{name}{number}": 1.0}


def mix(before: Shown, after: Shown, share: float) -> Shown:
    return {name: v * (1 - share) for name, v in before.items()} | {n: v * share for n, v in after.items()}


def test_a_dissolve_overlaps_the_end_of_one_and_the_beginning_of_the_next() -> None:
    shown = list(dissolve([(4, 0, clip("a", 4)), (5, 3, clip("b", 5))], mix))
    assert shown == [
        {"a0": 1.0},
        {"a1": 0.75, "b0": 0.25},
        {"a2": 0.5, "b1": 0.5},
        {"a3": 0.25, "b2": 0.75},
        {"b3": 1.0},
        {"b4": 1.0},
    ]


@st.composite
def edits(draw: st.DrawFn) -> list[tuple[int, int]]:
    """Lengths and dissolves for which there is room."""
    pieces = [(draw(st.integers(1, 8)), 0)]
    for _ in range(draw(st.integers(0, 5))):
        count = draw(st.integers(1, 8))
        before, lead = pieces[-1]
        pieces.append((count, draw(st.integers(0, min(count, before - lead)))))
    return pieces


@given(edits())
def test_every_frame_is_shown_once_and_all_light_adds_up(pieces: list[tuple[int, int]]) -> None:
    names = "abcdef"
    shown = list(dissolve([(n, d, clip(names[i], n)) for i, (n, d) in enumerate(pieces)], mix))
    assert len(shown) == sum(n - d for n, d in pieces)
    assert all(abs(sum(frame.values()) - 1.0) < 1e-12 for frame in shown)
    seen = [name for frame in shown for name in frame]
    assert sorted(seen) == sorted(f"{names[i]}{k}" for i, (n, _) in enumerate(pieces) for k in range(n))


def test_frames_are_mixed_by_their_display_values() -> None:
    black, white = (np.full((2, 2, 3), value, dtype=np.uint16) for value in (0, 65535))
    assert (mix_frames(black, white, 0.25) == 16384).all()
    assert mix_frames(black, white, 0.25).dtype == np.uint16
