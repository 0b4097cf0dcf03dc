"""What the sculpture stands on, in stage units, and where that is in the scene."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from render.errors import BadInputError
from render.plain import Triple

RINGS, SIDES = 33, 64
"""How finely a cyclorama is cut. Its normals are exact, so more would change no picture and cost rays."""


@dataclass(frozen=True)
class Placement:
    """Where the stage stands: the scene point under the subject's middle, and the subject's half-size.

    Stage and lights are scaled by `size`, turned by `turn` radians about the vertical (from +z towards
    +x) and then moved by `origin`, so a sculpture and its enlarged copy with an equally enlarged placement
    give the same picture.
    """

    origin: Triple = (0.0, 0.0, 0.0)
    size: float = 1.0
    turn: float = 0.0

    def __post_init__(self) -> None:
        if not (self.size > 0.0 and all(math.isfinite(x) for x in (*self.origin, self.size, self.turn))):
            raise BadInputError(
                f"placement has origin {self.origin} and size {self.size}; finite and size above 0 needed"
            )

    def matrix(self) -> NDArray[np.float64]:
        """(4, 4): stage units to scene units."""
        c, s = math.cos(self.turn), math.sin(self.turn)
        transform = np.eye(4)
        transform[:3, :3] = self.size * np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
        transform[:3, 3] = self.origin
        return transform


@dataclass(frozen=True)
class Stage:
    """A cyclorama seen from anywhere: a round floor that sweeps up into a wall without an edge.

    It is a shallow dish rather than a box: what a lens 10–20° above the floor sees is all there, and
    light that is scattered upwards leaves at once, which makes pictures several times cheaper.

    kind        "cyclorama", or "none" for a subject before the sky
    colour      linear Rec.709 reflectance
    floor       radius of the flat floor, stage units
    sweep       width of the ring in which it rises
    steepness   slope at the outer rim, radians
    """

    kind: str = "cyclorama"
    colour: Triple = (0.36, 0.355, 0.35)
    floor: float = 7.0
    sweep: float = 14.0
    steepness: float = math.radians(55.0)

    def __post_init__(self) -> None:
        if self.kind not in ("cyclorama", "none"):
            raise BadInputError(f"stage is {self.kind!r}; it can be cyclorama or none")
        if min(self.floor, self.sweep) <= 0.0 or not 0.0 < self.steepness <= math.pi / 2.0:
            raise BadInputError("a cyclorama's floor and sweep must be above 0, its steepness in 0° … 90°")

    def mesh(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.int32]]:
        """Vertices (V, 3), normals (V, 3) and faces (F, 3) of the cyclorama, seen from within."""
        return _revolve(*self._profile())

    def _profile(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Points (N, 2) of radius and height from the middle outwards, and their inward normals.

        The slope follows a smoothstep, so that the curvature begins and ends at 0: a plain arc meets
        the floor with a jump of curvature that reflections and gradients show as a line.
        """
        t = np.linspace(0.0, 1.0, RINGS)
        slope = self.steepness * t**3 * (10.0 - 15.0 * t + 6.0 * t**2)
        steps = np.stack([np.cos(slope), np.sin(slope)], axis=1)
        curve = np.concatenate([[[0.0, 0.0]], np.cumsum((steps[1:] + steps[:-1]) / 2.0, axis=0)])
        curve = curve / curve[-1, 0] * self.sweep + [self.floor, 0.0]
        inwards = np.stack([-np.sin(slope), np.cos(slope)], axis=1)
        middle = [[0.0, 0.0], [self.floor / 2.0, 0.0]]
        return np.concatenate([middle, curve]), np.concatenate([[[0.0, 1.0]] * 2, inwards])


def _revolve(
    profile: NDArray[np.float64], normals: NDArray[np.float64], sides: int = SIDES
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.int32]]:
    """Turn a profile of (radius, height) about the y axis; faces look towards the axis."""
    angle = np.linspace(0.0, 2.0 * math.pi, sides, endpoint=False)
    around = np.stack([np.cos(angle), np.sin(angle)], axis=1)

    def turned(pairs: NDArray[np.float64]) -> NDArray[np.float32]:
        ring = np.empty((len(pairs), sides, 3), dtype=np.float32)
        ring[..., 0] = pairs[:, :1] * around[:, 0]
        ring[..., 1] = pairs[:, 1:]
        ring[..., 2] = pairs[:, :1] * around[:, 1]
        return ring.reshape(-1, 3)

    i = np.arange(len(profile) - 1)[:, None] * sides
    j = np.arange(sides)[None, :]
    k = (j + 1) % sides
    inner_j, inner_k, outer_j, outer_k = i + j, i + k, i + sides + j, i + sides + k
    first = np.stack([inner_j, outer_k, outer_j], axis=-1)
    second = np.stack([inner_j, inner_k, outer_k], axis=-1)[1:]  # at the middle it would have no area
    faces = np.concatenate([first.reshape(-1, 3), second.reshape(-1, 3)]).astype(np.int32)
    return turned(profile), turned(normals), faces


STAGES = {
    "cyclorama": Stage(),
    "none": Stage(kind="none"),
}
