"""RGB spaces: the linear ones that frames are rendered in, and encodings of stored values.

Descriptions (materials, lights, stages) hold linear Rec.709 colours. `in_working_space` converts them before
a scene is built, so whatever follows from a colour follows from the converted one. Neutral colours keep
their value in every working space, and so do the other numbers of a description. An `RgbEncoding` turns
values of a file into linear Rec.709. The file names it by chromaticities (EXR, PNG, Radiance), by an exponent
(PNG) or by an ICC profile.
"""

from __future__ import annotations

import struct
import typing
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.serialise import Colour

T = TypeVar("T")

LUMA = np.array([0.2126, 0.7152, 0.0722])
"""Weights of red, green and blue in the luminance of linear Rec.709 (ITU-R BT.709-6, 3.2)."""

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
    matrix = np.linalg.inv(target.to_xyz) @ _adaptation(source.white, target.white) @ source.to_xyz
    return np.asarray(matrix / matrix.sum(axis=1, keepdims=True))  # exact for neutral colours


def _adaptation(source: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the matrix (3, 3) that adapts CIE XYZ from one white (3,) to another, by Bradford's method."""
    gain = np.diag((BRADFORD @ target) / (BRADFORD @ source))
    return np.asarray(np.linalg.inv(BRADFORD) @ gain @ BRADFORD)


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
    if hint is Colour or (hint == Colour | None and value is not None):
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


Curve = Callable[[NDArray[np.floating]], NDArray[np.floating]]
"""Turns stored values, of any shape, into linear ones."""

Matrix = NDArray[np.float64]

_D50 = (0.9642, 1.0, 0.8249)
"""CIE XYZ of the white that ICC profiles count from (ICC.1:2022, 7.2.16)."""

_SAME_CURVE, _SAME_MATRIX = 0.003, 0.005
"""Differences that profiles of one space have, by their rounding: of linear values, and of matrix entries."""

_MOST_POINTS = 1 << 16

_DAMAGED = "its colour profile is damaged"


def srgb_of_linear(linear: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return sRGB values from 0 to 1 of linear ones (IEC 61966-2-1)."""
    light = np.clip(np.asarray(linear, dtype=np.float64), 0.0, 1.0)
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1.0 / 2.4) - 0.055)


def linear_of_srgb(srgb: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the linear values of sRGB values 0 … 1 (IEC 61966-2-1)."""
    srgb = np.asarray(srgb, dtype=np.float64)
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def same(values: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return linear values as they are: the curve of linear encodings."""
    return values


def power(exponent: float) -> Curve:
    """Return the curve that raises values to a power; those below 0 become 0."""
    return lambda values: np.maximum(values, 0.0) ** exponent


@dataclass(frozen=True, eq=False)
class RgbEncoding:
    """Curves for red, green and blue, and the matrix (3, 3) from them to linear Rec.709."""

    curves: tuple[Curve, Curve, Curve]
    matrix: Matrix

    def linear(self, pixels: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return linear Rec.709 pixels (…, 3). Colours outside its gamut go below 0 or above 1."""
        light = np.stack([curve(pixels[..., i]) for i, curve in enumerate(self.curves)], axis=-1)
        return np.asarray(light @ self.matrix.T, dtype=np.float32)

    @property
    def is_linear(self) -> bool:
        """True where stored values are proportional to light."""
        return self._has_curves(same)

    def is_like(self, curve: Curve) -> bool:
        """Tell whether this is the encoding of Rec.709's primaries with a curve, within rounding."""
        return self._has_curves(curve) and bool(np.abs(self.matrix - np.eye(3)).max() < _SAME_MATRIX)

    def _has_curves(self, curve: Curve) -> bool:
        ramp = np.linspace(0.0, 1.0, 256)
        return all(float(np.abs(own(ramp) - curve(ramp)).max()) < _SAME_CURVE for own in self.curves)


def encoding_of(chromaticities: Sequence[float], curve: Curve = same) -> RgbEncoding | None:
    """Return the encoding of chromaticities, CIE x and y of red, green, blue and white, with one curve.

    None where all are 0, as programs write that know none. Raises ValueError where they span no colours.
    """
    values = tuple(float(value) for value in chromaticities)
    if not any(values):
        return None
    space = WorkingSpace("", "", values)  # type: ignore[arg-type]  # eight values
    try:
        if len(values) != 8 or not np.isfinite(values).all() or values[7] <= 0.0:
            raise ValueError
        matrix = space.to_rec709(np.eye(3)).T
        if not (np.isfinite(matrix).all() and np.abs(matrix).max() < 1e3):
            raise ValueError
    except (ValueError, np.linalg.LinAlgError):
        raise ValueError("its chromaticities span no colours") from None
    return RgbEncoding((curve,) * 3, matrix)


def encoding_of_icc(profile: bytes) -> RgbEncoding:
    """Return the encoding of an ICC profile that has curves and primaries, or a curve of grey.

    Raises ValueError with the reason for profiles of other spaces, those that are tables, and damaged ones.
    """
    try:
        kind = profile[16:20].decode("ascii", "replace").strip()
        if kind not in ("RGB", "GRAY"):
            raise ValueError(f"its colour profile is for {kind}")
        tags = _tags(profile)
        if kind == "GRAY":
            return RgbEncoding((_curve(tags["kTRC"]),) * 3, np.eye(3))
        if not {"rXYZ", "rTRC"} <= tags.keys():
            raise ValueError("its colour profile is a table, not curves and primaries")
        columns = [_numbers(tags[f"{name}XYZ"], 8, 3) for name in "rgb"]  # XYZType, 10.31
        red, green, blue = (_curve(tags[f"{name}TRC"]) for name in "rgb")
        return RgbEncoding((red, green, blue), _from_d50(np.array(columns).T))
    except (KeyError, IndexError, struct.error):
        raise ValueError(_DAMAGED) from None


def _tags(profile: bytes) -> dict[str, bytes]:
    """Return the content of tags by signature."""
    (count,) = struct.unpack_from(">I", profile, 128)
    tags = {}
    for index in range(min(count, 200)):
        name, start, size = struct.unpack_from(">4sII", profile, 132 + 12 * index)
        tags[name.decode("ascii", "replace")] = profile[start : start + size]
    return tags


def _numbers(tag: bytes, start: int, count: int) -> list[float]:
    """Return numbers of 16 bits before and 16 after the point (s15Fixed16Number)."""
    return [number / 65536.0 for number in struct.unpack_from(f">{count}i", tag, start)]


def _curve(tag: bytes) -> Curve:
    """Return the curve of a tag (ICC.1:2022, 10.6 curveType and 10.18 parametricCurveType)."""
    if tag[:4] == b"para":
        (kind,) = struct.unpack_from(">H", tag, 8)
        return _parametric(_numbers(tag, 12, (1, 3, 4, 5, 7)[kind]))
    (count,) = struct.unpack_from(">I", tag, 8)
    if tag[:4] != b"curv" or count > _MOST_POINTS:
        raise ValueError(_DAMAGED)
    if count == 0:
        return same
    points = np.array(struct.unpack_from(f">{count}H", tag, 12))
    if count == 1:
        return power(points[0] / 256.0)
    places, linear = np.linspace(0.0, 1.0, count), points / 65535.0
    return lambda values: np.interp(values, places, linear)


def _parametric(numbers: list[float]) -> Curve:
    """Return (a·x + b)^g + e from x = d on, c·x + f below; shorter lists are the types 0 to 3."""
    g, a, b, c, d, e, f = 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if len(numbers) == 1:
        (g,) = numbers
    elif len(numbers) < 5:
        g, a, b, e = (*numbers, 0.0)[:4]
        d, f = (-b / a if a else 0.0), e
    else:
        g, a, b, c, d, e, f = (*numbers, 0.0, 0.0)[:7]
    return lambda x: np.where(x >= d, np.maximum(a * x + b, 0.0) ** g + e, c * x + f)


def _from_d50(columns: Matrix) -> Matrix:
    """Return the matrix to linear Rec.709 of primaries in CIE XYZ under D50, which has neutral greys."""
    matrix = np.linalg.inv(REC709.to_xyz) @ _adaptation(np.array(_D50), REC709.white) @ columns
    if not np.isfinite(matrix).all() or (np.abs(matrix.sum(axis=1)) < 0.1).any():
        raise ValueError(_DAMAGED)
    return np.asarray(matrix / matrix.sum(axis=1, keepdims=True))
