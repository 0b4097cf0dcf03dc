"""Working spaces: the linear RGB spaces that frames can be rendered in, and the conversion to them.

Descriptions (materials, lights, stages) hold linear Rec.709 colours. `in_working_space` converts them before
a scene is built, so whatever follows from a colour follows from the converted one. Neutral colours keep
their value in every working space, and so do the other numbers of a description.
"""

from __future__ import annotations

import typing
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from render.base.serialise import Colour

T = TypeVar("T")

BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
"""From CIE XYZ to cone responses (Lam 1985; ICC.1:2010, annex E)."""


@dataclass(frozen=True)
class WorkingSpace:
    """A linear RGB space.

    name            in shot files
    interop_id      its name in EXR headers, `colorInteropID`, and in OpenColorIO's built-in configs
    chromaticities  CIE x and y of red, green, blue and white
    """

    name: str
    interop_id: str
    chromaticities: tuple[float, float, float, float, float, float, float, float]

    @property
    def is_rec709(self) -> bool:
        """True for the space of descriptions."""
        return self == REC709

    @property
    def white(self) -> NDArray[np.float64]:
        """CIE XYZ (3,) of the white, whose Y is 1."""
        return _xyz(self)[:, 3]

    @property
    def to_xyz(self) -> NDArray[np.float64]:
        """The matrix (3, 3) to CIE XYZ (SMPTE RP 177)."""
        points = _xyz(self)
        return np.asarray(points[:, :3] * np.linalg.solve(points[:, :3], points[:, 3]))

    def from_rec709(self, colours: NDArray[np.floating]) -> NDArray[np.float64]:
        """Convert linear Rec.709 colours (…, 3) to this space."""
        return np.asarray(colours @ _matrix(REC709, self).T, dtype=np.float64)

    def to_rec709(self, colours: NDArray[np.floating]) -> NDArray[np.float64]:
        """Convert colours (…, 3) of this space to linear Rec.709. Colours outside its gamut go below 0."""
        return np.asarray(colours @ _matrix(self, REC709).T, dtype=np.float64)


REC709 = WorkingSpace("rec709", "lin_rec709_scene", (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290))
"""ITU-R BT.709-6, table 1."""

ACESCG = WorkingSpace("acescg", "lin_ap1_scene", (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767))
"""Primaries AP1 and the white of ACES (Academy S-2014-004)."""

WORKING_SPACES = {space.name: space for space in (REC709, ACESCG)}


@cache
def _matrix(source: WorkingSpace, target: WorkingSpace) -> NDArray[np.float64]:
    """Return the matrix (3, 3) between spaces. Bradford's adaptation keeps neutral colours neutral."""
    white = [BRADFORD @ space.white for space in (source, target)]
    adaptation = np.linalg.inv(BRADFORD) @ np.diag(white[1] / white[0]) @ BRADFORD
    matrix = np.linalg.inv(target.to_xyz) @ adaptation @ source.to_xyz
    return np.asarray(matrix / matrix.sum(axis=1, keepdims=True))  # exact for neutral colours


def _xyz(space: WorkingSpace) -> NDArray[np.float64]:
    """Return CIE XYZ (3, 4) of red, green, blue and white, each with Y = 1, or 0 where its y is 0."""
    x, y = np.reshape(space.chromaticities, (4, 2)).T
    scale = np.where(y == 0.0, 1.0, y)
    return np.stack([x / scale, y / scale, (1.0 - x - y) / scale])


def in_working_space(value: T, space: WorkingSpace) -> T:
    """Return a description with its colours in a working space.

    Fields typed `Colour` are converted, at any depth. A dataclass whose colours come from elsewhere, such as
    a file, has a field `working_space`, which names the space that it shall convert them to.
    """
    return value if space.is_rec709 else typing.cast(T, _converted(type(value), value, space))


def _converted(hint: Any, value: Any, space: WorkingSpace) -> Any:
    if hint is Colour:
        return tuple(space.from_rec709(np.array(value)).tolist())
    if isinstance(value, tuple) and typing.get_origin(hint) is tuple:
        inner = typing.get_args(hint)[0]
        return tuple(_converted(inner, item, space) for item in value)
    if not is_dataclass(value) or isinstance(value, type):
        return value
    hints = _hints_of(type(value))
    names = [part.name for part in fields(value) if part.init]
    changed = {name: _converted(hints[name], getattr(value, name), space) for name in names}
    if "working_space" in changed:
        changed["working_space"] = space.name
    return replace(value, **changed)


def converted_pixels(pixels: NDArray[np.float32], name: str) -> NDArray[np.float32]:
    """Convert linear Rec.709 pixels (…, 3) to the working space of that name."""
    space = WORKING_SPACES[name]
    return pixels if space.is_rec709 else space.from_rec709(pixels).astype(np.float32)


@cache
def _hints_of(kind: type) -> dict[str, Any]:
    return typing.get_type_hints(kind, include_extras=True)
