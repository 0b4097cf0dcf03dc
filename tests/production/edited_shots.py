"""Shots of small motions, and edits of them as productions make: handles, trims, moved frames, speeds."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from hypothesis import strategies as st

BOX = "subject: {solid: box, size: [1, 2, 1]}\n"
RESAMPLED = "resample: {max_edge_length: 0.7}\n"
SUBJECTS = {
    "exact": BOX + "resample: {max_edge_length: 0.7, rest_interval: 2}\n",
    "curved": BOX + "resample: {max_edge_length: 0.7, placement: curved}\n",
    "chord": BOX + "resample: {max_edge_length: 0.7, placement: chord}\n",
    "polyhedra": BOX + "resample: {max_edge_length: 0.9, method: polyhedra}\n",
    "lengths by the frame number": BOX + 'resample: {max_edge_length: {formula: "0.6 + frame / 10000"}}\n',
    "not resampled": BOX + "resample: off\n",
    "cloud": "subject: {cloud: {solid: icosphere, radius: 1}, count: 40, radius: 0.06}\n",
    "copies": "subjects:\n"
    "  beads: {solid: box, copies: {count: 3, rigid: true, region: {box: {size: [9, 9, 9]}}}}\n" + RESAMPLED,
    "two": "subjects:\n"
    "  crane: {solid: box, size: [1, 1, 1], place: [-1, 0, 0]}\n"
    "  heron: {solid: icosphere, radius: 0.6, place: [1, 0, 0]}\n" + RESAMPLED,
}
BECOME = "  - become: {solid: box, size: [1, 2, 1], from: FIRST, to: LAST, detail: coarse}\n"
SUBJECTS_BY_FITS = {"become": "subject: {solid: icosphere, radius: 0.8}\n" + RESAMPLED}
"""Subjects whose flow is fitted first, for some seconds."""
SPEEDS = {
    "steady": "1",
    "slower": "0.5",
    "by frames": "{keys: {FIRST: 1, LAST: 2}}",
    "by seconds": "{keys: {0s: 2, 0.04s: 1}}",
    "by the frame number": '{formula: "1 + frame / 10000"}',
}
STRENGTHS = {
    "steady": "1.5",
    "by frames": "{keys: {FIRST: 0, LAST: 3}}",
    "by seconds": "{keys: {0s: 0, 0.04s: 3}}",
    "by the frame number": '{formula: "2 * frame / 1000"}',
    "by the time": '{formula: "3 * t"}',
}


@dataclass(frozen=True)
class EditedShot:
    """What a shot file says: the names of a subject, a speed and a strength, and the first and last frame."""

    subject: str
    first: int
    last: int
    speed: str = "steady"
    strength: str = "steady"

    @property
    def text(self) -> str:
        """The shot file."""
        text = (
            f"title: Edited\nframes: {self.first}-{self.last}\n"
            f"{(SUBJECTS | SUBJECTS_BY_FITS)[self.subject]}speed: {SPEEDS[self.speed]}\nflows:\n"
            f"  - vortex: {{axis: y, centre: [0.5, 0, 0], radius: 1, strength: {STRENGTHS[self.strength]}}}\n"
            + (BECOME if self.subject == "become" else "")
        )
        return text.replace("FIRST", str(self.first)).replace("LAST", str(self.last))

    def edited(self, kind: str, by: int) -> EditedShot:
        """Return the shot with longer handles, fewer frames, other numbers, or the next speed or strength."""
        match kind:
            case "handles":
                return replace(self, first=self.first - by, last=self.last + by % 3)
            case "trim":
                return replace(self, first=min(self.first + by, self.last - 1))
            case "shorten":
                return replace(self, last=max(self.last - by, self.first + 1))
            case "lengthen":
                return replace(self, last=self.last + by)
            case "move":
                return replace(self, first=self.first + by, last=self.last + by)
            case "move far":
                return replace(self, first=self.first + 1000 * by, last=self.last + 1000 * by)
            case "move back":
                return replace(self, first=self.first - by, last=self.last - by)
        table = SPEEDS if kind == "speed" else STRENGTHS
        names = list(table)
        return replace(self, **{kind: names[(names.index(getattr(self, kind)) + by) % len(names)]})


KINDS = ("handles", "trim", "shorten", "lengthen", "move", "move far", "move back", "speed", "strength")
edits = st.tuples(st.sampled_from("AB"), st.sampled_from(KINDS), st.integers(1, 3))
"""The shot that is edited, how, and by how much."""


def shots(subjects: Iterable[str]) -> st.SearchStrategy[EditedShot]:
    """Return the shots of these subjects, with a few frames."""
    return st.builds(
        lambda subject, first, count, speed, strength: EditedShot(
            subject, first, first + count, speed, strength
        ),
        st.sampled_from(sorted(subjects)),
        st.sampled_from([1, 0, -3, 1001]),
        st.integers(2, 4),
        st.sampled_from(sorted(SPEEDS)),
        st.sampled_from(sorted(STRENGTHS)),
    )
