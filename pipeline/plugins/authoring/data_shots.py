"""New shots of measured or simulated velocities in files: what they draw out of seeds."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flowsculpt import MissingInputError, UsageError, VelocityField
from flowsculpt.api import ShotError
from flowsculpt.api.flows import Sampled
from flowsculpt.api.frames import Show
from flowsculpt.api.meshes import Floats
from flowsculpt.api.shots import PRESETS, Shot, read_shot, to_yaml
from flowsculpt.pipeline.plugins.authoring.shot_templates import FIT, choice, title_of

SECONDS = 10.0
"""Of the shot; in it a point of median speed crosses the data."""

FLAT = 20.0
"""Times as long as the others that an axis along which nothing changes may be, as of data of one level."""

_AWAY = 1.35  # of the camera, in diagonals of the data
_LOOKED_AT = 64  # places on a line of seeds

SHOT = """\
title: {title}
frames: 1-{frames}
{about}
subject: {subject}
look:
  material: clay
  pigment: {{layers: {{colours: ["#e8e2d0", "#136f8a", "#0b2545"], axis: z, scale: {band}}}}}
camera: {camera}
lights: {lights}
stage: {stage}
"""

PROBE = """\
title: Data
frames: 1-2
subject: {{solid: icosphere}}
resample: off
flows: [{{sampled: {sampled}}}]
"""


@dataclass(frozen=True)
class _Seen:
    """What a look at the data tells.

    low, high  (3,) corners of where it is, units
    flat       the axis along which nothing changes, 0 to 2; None of data in space
    pace       seconds of the data in a second of the shot, or a factor on the velocities
    is_paced   True if it is seconds
    seconds    of the data in the shot; infinite where the velocities do not change
    """

    low: Floats
    high: Floats
    flat: int | None
    pace: float
    is_paced: bool
    seconds: float


def shot_of_data(data: Path, name: str) -> tuple[str, list[str]]:
    """Return the text of a new shot of a file of velocities, and lines to tell about it.

    Raises UsageError where nothing moves in it, and what `read_shot` raises where it cannot be read.
    """
    if not data.exists():
        raise MissingInputError(f"{data}: not found; check the path")
    reference = Path(os.path.relpath(data.absolute(), Show().folder.resolve())).as_posix()
    settings, shot = _placed(data)
    seen = _look(shot, data)
    settings |= (
        {"time_scale": _duration(seen.pace)} if seen.is_paced else {"strength": float(f"{seen.pace:.3g}")}
    )
    _, shot = _read(data, settings)
    field, size = _field(shot), float((seen.high - seen.low).max())
    seeds = [[float(f"{x:.3g}") for x in end] for end in _seeds(field, seen)]

    def text_with(named: str) -> str:
        subject: dict[str, object] = {"path_lines": {"line": seeds}, "count": 48}
        subject |= {"radius": float(f"{size / 500:.2g}"), "flatten": 0.3}
        subject |= {"velocity": [{"sampled": {"file": named, **settings}}], "begin": -1.0}
        subject["max_edge_length"] = float(f"{size / 60:.2g}")
        return SHOT.format(
            title=title_of(name),
            frames=max(24, round(24.0 * min(SECONDS, seen.seconds))),
            about=f"# flowsculpt data {data.name} lists what the file holds.",
            subject=to_yaml(subject),
            band=float(f"{size / 8:.2g}"),
            camera=to_yaml(_camera(seen)),
            lights=choice(PRESETS["lights"]),
            stage=choice(PRESETS["stage"]),
        )

    shot = read_shot(Path(f"{name}.yaml"), text_with(str(data.absolute())))  # shots/ may not be there yet
    return text_with(reference), [f"{data} stays where it is; the shot names it {reference}", *shot.notes]


def _placed(data: Path) -> tuple[dict[str, object], Shot]:
    """Return the settings that make the data FIT units large, and a shot with them."""
    try:
        return _read(data, {"fit": FIT})
    except ShotError as error:
        if "fit does not apply" not in str(error):
            raise
    _, shot = _read(data, {})
    axes = _field(shot).samples.axes
    middle, size = [0.5 * (axis[0] + axis[-1]) for axis in axes], max(float(np.ptp(axis)) for axis in axes)
    scale = FIT / size
    centre = [float(f"{-scale * x:.4g}") for x in middle]
    return _read(data, {"scale": float(f"{scale:.4g}"), "centre": centre})


def _read(data: Path, settings: dict[str, object]) -> tuple[dict[str, object], Shot]:
    sampled = to_yaml({"file": str(data.absolute()), **settings})
    return settings, read_shot(Path("data.yaml"), PROBE.format(sampled=sampled))


def _field(shot: Shot) -> Sampled:
    field = shot.motion.flow.members[0].field  # type: ignore[attr-defined]  # along streamlines
    assert isinstance(field, Sampled), "so the probe says"
    return field


def _look(shot: Shot, data: Path) -> _Seen:
    field = _field(shot)
    centre, scale = np.array(field.centre, np.float64), float(field.scale)  # type: ignore[arg-type]
    ends = np.array([[axis[0], axis[-1]] for axis in field.samples.axes]).T * scale + centre
    low, high = ends.min(axis=0), ends.max(axis=0)
    sides = high - low
    flat = int(sides.argmax()) if sides.max() > FLAT * np.sort(sides)[1] else None
    if flat is not None:
        low[flat], high[flat] = 0.0, 0.0
    times = field.samples.times
    speeds = np.linalg.norm(field.velocity(_nodes(low, high), 0.0), axis=1)
    speeds = speeds[speeds > 0.0]
    if not len(speeds):
        raise UsageError(f"{data}: nothing moves at its first time. Choose another file or variables.")
    pace = float((high - low).max() / (SECONDS * np.median(speeds)))
    paced = field.samples.is_paced
    seconds = float(times[-1] - times[0]) / (pace if paced else 1.0) if len(times) > 1 else np.inf
    return _Seen(low, high, flat, pace, paced, seconds)


def _nodes(low: Floats, high: Floats) -> Floats:
    """Return points (N, 3) on a grid within a box; a few on each axis, one on an axis without a length."""
    counts = [1 if a == b else 24 for a, b in zip(low, high, strict=True)]
    axes = [a + (b - a) * (np.arange(n) + 0.5) / n for a, b, n in zip(low, high, counts, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def _seeds(field: VelocityField, seen: _Seen) -> Floats:
    """Return the ends (2, 3) of a line through the middle of data, along the axis that is most crossed."""
    middle, sides = 0.5 * (seen.low + seen.high), seen.high - seen.low
    lines, across = [], []
    for axis in np.flatnonzero(sides > 0.0):
        reach = 0.45 * sides[axis] * np.eye(3)[axis]
        points = middle + np.linspace(-1.0, 1.0, _LOOKED_AT)[:, None] * reach
        velocity = field.velocity(points, 0.0)
        velocity[:, axis] = 0.0
        lines.append(np.stack([middle - reach, middle + reach]))
        across.append(float(np.linalg.norm(velocity, axis=1).mean()))
    return lines[int(np.argmax(across))]


def _camera(seen: _Seen) -> dict[str, object]:
    """Return a camera that shows all of the data: flat data from the front, others from the upper right."""
    middle, size = 0.5 * (seen.low + seen.high), float(np.linalg.norm(seen.high - seen.low))
    away = np.array([0.0, 0.0, 1.0]) if seen.flat == 2 else np.array([0.42, 0.3, 0.86])
    if seen.flat == 1:
        away = np.array([0.0, 0.8, 0.6])
    position = middle + _AWAY * size * away
    places = {"position": position, "target": middle}
    return {
        **{name: [round(float(x), 3) for x in place] for name, place in places.items()},
        "focal_length": 50,
    }


def _duration(seconds: float) -> object:
    """Return seconds as shot files say a length of time."""
    for unit, length in (("day", 86400.0), ("h", 3600.0)):
        if seconds >= length:
            return f"{float(f'{seconds / length:.2g}'):g} {unit}"
    return float(f"{seconds:.2g}")
