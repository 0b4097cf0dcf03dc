"""The table of AOVs: the named arrays of a rendered frame, and how EXR files keep them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Aov:
    """An AOV: the letters of its channels, their precision in a file (half or float), and its meaning."""

    letters: str
    precision: str
    meaning: str


ALWAYS = {
    "beauty": Aov("RGB", "half", "light"),
    "albedo": Aov("RGB", "half", "reflectance"),
    "normal": Aov("XYZ", "half", "shading normal"),
    "position": Aov("XYZ", "float", "position in the scene"),
    "depth": Aov("Z", "float", "distance from the lens"),
    "matte": Aov("A", "half", "coverage of the pixel by the subject"),
}
"""AOVs of every frame."""

EXTRA = {
    "velocity": Aov("XYZ", "half", "of the subject, scene units per second"),
    "motion": Aov("XY", "half", "pixels right and up from this frame to the next, as the camera sees it"),
    "before": Aov("XYZ", "half", "of the subject, to its position a frame earlier, scene units"),
    "after": Aov("XYZ", "half", "of the subject, to its position a frame later, scene units"),
    "rest": Aov("XYZ", "float", "position before any flow moved it"),
    "noise": Aov("Y", "half", "standard error of the beauty's luminance"),
    "samples": Aov("N", "float", "samples per pixel"),
}
"""AOVs of a frame that asks for them."""

AOVS = {**ALWAYS, **EXTRA}

NEEDED_BY_AOV = {
    "velocity": "velocities",
    "motion": "the next frame",
    "before": "the frame before",
    "after": "the next frame",
    "rest": "rest positions",
}
"""What the subject must be given for an AOV, in the words of messages."""

VERTEX_AOVS = tuple(NEEDED_BY_AOV)
"""AOVs that show an attribute of the subject's vertices."""
