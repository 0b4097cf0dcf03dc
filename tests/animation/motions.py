"""What tests of the frame loop share: other settings of a motion, and equality of frames."""

from __future__ import annotations

import dataclasses

from flowsculpt.pipeline.animation import MeshFrame
from flowsculpt.pipeline.arrays import AnyArray
from flowsculpt.pipeline.shot import Motion

EDGE = 0.25
"""The longest edge of the motion, scene units."""


def same(one: MeshFrame, other: MeshFrame) -> bool:
    return (
        one.number == other.number
        and one.report == other.report
        and one.mesh.vertices.tobytes() == other.mesh.vertices.tobytes()
        and one.mesh.faces.tobytes() == other.mesh.faces.tobytes()
        and one.mesh.creases.tobytes() == other.mesh.creases.tobytes()
        and one.mesh.attributes.keys() == other.mesh.attributes.keys()
        and all(v.tobytes() == other.mesh.attributes[n].tobytes() for n, v in one.mesh.attributes.items())
        and births(one).tobytes() == births(other).tobytes()
        and (one.identities, one.unsorted) == (other.identities, other.unsorted)
    )


def births(frame: MeshFrame) -> AnyArray:
    assert frame.births is not None
    return frame.births


def resampled(motion: Motion, **settings: object) -> Motion:
    """The motion with other settings of its resampling."""
    assert motion.resampling is not None
    return dataclasses.replace(motion, resampling=dataclasses.replace(motion.resampling, **settings))  # type: ignore[arg-type]
