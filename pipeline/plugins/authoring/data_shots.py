"""New shots of measured or simulated velocities in files: what they draw out of seeds."""

from __future__ import annotations

import os
import re
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from flowsculpt import MissingInputError, UsageError
from flowsculpt.api import ShotError
from flowsculpt.api.flows import Sampled
from flowsculpt.api.frames import Show
from flowsculpt.api.meshes import Floats
from flowsculpt.api.shots import PRESETS, Shot, read_shot, to_yaml
from flowsculpt.pipeline.plugins.authoring.land_pictures import around_globe, land_at, over_plate, write_land
from flowsculpt.pipeline.plugins.authoring.new_files import Content
from flowsculpt.pipeline.plugins.authoring.shot_templates import FIT, choice, title_of

SECONDS = 10.0
"""Of the shot: all times of the data pass in it, or else a point of median speed crosses the data."""

FLAT = 20.0
"""Times as long as the others that an axis along which nothing changes may be, as of data of one level."""

GLOBE = 0.9
"""Share of a circle that longitudes cover, from which data lie on a sphere."""

_AWAY = 1.75  # of the camera, in diagonals of the data
_AROUND = 1.2  # width of the picture where data of one level are, in theirs
FOCAL_LENGTH = 50.0  # mm; a picture is 36 by 20.25 mm
_REACH = 0.3  # of streamlines at the speed of the end of the palette, in sizes of the data
_ROWS = 16  # of seeds, across a plane of the data
_TURNS = 40  # of seeds, on a globe: nearer than seeds on a turn, since most flows go around
_LINES = {True: 1000, False: 480}  # on a globe, and across a plane
_PLATE = 1.1  # sides of the plate behind data of one level, over theirs
_BRIGHT = 98.0  # per cent of the speeds that are below the end of the palette

SHOT = """\
title: {title}
frames: 1-{frames}
{about}
{subject}
look:
  material: clay
  measure: {{values: {{range: {range}}}}}  # or colours: plasma, cividis, or a list of your own
camera: {camera}
lights: {lights}
stage: {{kind: cyclorama, colour: [0.02, 0.03, 0.045]}}
legend: {legend}
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
    """The facts about data that a new shot follows.

    low, high  (3,) corners of where it is, units
    flat       the axis along which nothing changes, 0 to 2; None of data in space
    is_globe   True if it goes around a sphere
    is_dated   True if its times are dates
    seconds    from its first time to its last; 0 where the velocities do not change
    median     of the speeds, units per second of the data
    fastest    _BRIGHT % of the speeds are slower, units per second of the data
    """

    low: Floats
    high: Floats
    flat: int | None
    is_globe: bool
    is_dated: bool
    seconds: float
    median: float
    fastest: float

    @property
    def size(self) -> float:
        return float((self.high - self.low).max())


def shot_of_data(data: Path, name: str) -> tuple[str, dict[Path, Content], list[str]]:
    """Return the text of a new shot of a file of velocities, files beside it, and lines to tell about it.

    Raises UsageError where nothing moves in it, and what `read_shot` raises where it cannot be read.
    """
    if not data.exists():
        raise MissingInputError(f"{data}: not found; check the path")
    reference = Path(os.path.relpath(data.absolute(), Show().folder.resolve())).as_posix()
    settings, shot = _placed(data)
    field = _field(shot)
    seen = _look(field, data, is_globe="map" in settings)
    pace, settings = _paced(field, seen, settings)
    land, picture = _land(field, seen), f"{name}_land.png"

    def text_with(named: str, land_file: str = "") -> str:
        legend: dict[str, object] = {"colours": {"place": "lower right"}}
        if seen.is_dated:
            legend["clock"] = {"place": "upper right"}
        return SHOT.format(
            title=title_of(name),
            frames=round(24.0 * SECONDS),
            about=f"# flowsculpt data {data.name} lists variables; values: {{variable: NAME}} shows one.",
            subject=_subject(seen, _lines(field, seen, pace, {"file": named, **settings}), land_file),
            range=to_yaml([0, _rounded(seen.fastest * _in_data(field, pace))]),
            camera=to_yaml(_camera(seen)),
            lights=choice(PRESETS["lights"], "studio"),
            legend=to_yaml(legend),
        )

    shot = read_shot(Path(f"{name}.yaml"), text_with(str(data.absolute())))  # shots/ may not be there yet
    remarks = [f"{data} stays where it is; the shot names it {reference}", *shot.notes]
    if land is None:
        return text_with(reference), {}, remarks
    return text_with(reference, picture), {Show().folder / picture: partial(write_land, land)}, remarks


def _paced(field: Sampled, seen: _Seen, settings: dict[str, object]) -> tuple[float, dict[str, object]]:
    """Return the factor on velocities, and the settings with what sets the pace.

    Where velocities change, all their times pass. Else a point of median speed crosses the data.
    """
    crossing = seen.size / (SECONDS * seen.median)
    if field.samples.is_paced:
        pace = seen.seconds / SECONDS or crossing
        return pace, settings | {"time_scale": _duration(pace)}
    if seen.seconds:
        return 1.0, settings | {"time_scale": _rounded(seen.seconds / SECONDS)}
    return crossing, settings | {"strength": _rounded(crossing)}


def _lines(field: Sampled, seen: _Seen, pace: float, sampled: dict[str, object]) -> dict[str, object]:
    """Return the subject: streamlines in each frame where velocities change, else paths that grow."""
    seeds: dict[str, object] = {"line": _rows(field, seen)}
    if seen.is_globe:
        seeds = {"spiral": {"radius": _rounded(0.5 * seen.size), "turns": _TURNS}}
    subject: dict[str, object] = {"stream_lines" if seen.seconds else "path_lines": seeds}
    subject |= {"count": _LINES[seen.is_globe], "radius": _rounded(seen.size / 380.0)}
    subject |= {"length": _rounded(_REACH * seen.size / (seen.fastest * pace))} if seen.seconds else {}
    subject |= {"max_edge_length": _rounded(seen.size / 50.0), "values": "speed", "taper": 0.3}
    return {**subject, "velocity": [{"sampled": sampled}]}


def _subject(seen: _Seen, lines: dict[str, object], land_file: str) -> str:
    """Return the lines of the shot file that say what is shown: data of one level lie on something."""
    if seen.flat is None and not seen.is_globe:
        return f"subject: {to_yaml(lines)}"
    return f"subjects:\n  flow: {to_yaml(lines)}\n  base: {to_yaml(_base(seen, land_file))}"


def _land(field: Sampled, seen: _Seen) -> np.ndarray | None:
    """Return a picture of land on a globe or a plate; None without land."""
    if seen.is_globe:
        return land_at(field, around_globe(0.5 * seen.size))
    if seen.flat != 2:
        return None
    points = over_plate(0.5 * (seen.low + seen.high), _PLATE * (seen.high - seen.low))
    inside = np.all((points >= seen.low) & (points <= seen.high), axis=-1)
    return land_at(field, points, np.asarray(inside))


def _base(seen: _Seen, land_file: str) -> dict[str, object]:
    """Return the dark subject on which lines lie: a globe, or a plate behind data of one level."""
    look: dict[str, object] = {"material": "clay", "colour": land_file or [0.03, 0.033, 0.04]}
    if land_file:
        look["projection"] = {"kind": "spherical"}
    if land_file and not seen.is_globe:
        middle, wide = 0.5 * (seen.low + seen.high), _PLATE * (seen.high - seen.low)[0]
        centre = [_rounded(x) for x in middle]
        look["projection"] = {"kind": "planar", "axis": "z", "scale": _rounded(wide), "centre": centre}
    if seen.is_globe:
        return {"solid": "icosphere", "radius": _rounded(0.4975 * seen.size), "resample": "off", "look": look}
    thin = 0.02 * seen.size
    sides = np.where(np.arange(3) == seen.flat, thin, _PLATE * (seen.high - seen.low))
    place = 0.5 * (seen.low + seen.high) - (0.5 * thin + seen.size / 300.0) * np.eye(3)[seen.flat or 0]
    placed = {"size": [_rounded(x) for x in sides], "place": [_rounded(x) for x in place]}
    return {"solid": "box", **placed, "resample": "off", "look": look}


def _in_data(field: Sampled, pace: float) -> float:
    """Return the factor from units per second of the data to the unit in which its speed is shown."""
    metre = field.samples.metre
    return pace if metre is None or not field.samples.is_paced else 1.0 / (metre * float(field.scale))  # type: ignore[arg-type]


def _placed(data: Path) -> tuple[dict[str, object], Shot]:
    """Return the settings that make the data FIT units large, on a sphere if they go around it, and a shot
    with them."""
    globe: dict[str, object] = {"map": "sphere", "fit": FIT}
    try:
        settings, shot = _read(data, {"fit": FIT, "outside": "zero"})
    except ShotError as error:
        if "fit does not apply" not in str(error):
            raise
    else:
        with suppress(ShotError):  # no longitudes and latitudes
            _, around = _read(data, globe)
            longitudes = _field(around).samples.axes[0]
            if np.ptp(longitudes) * len(longitudes) / (len(longitudes) - 1) > GLOBE * 2.0 * np.pi:
                return globe, around
        return settings, shot
    _, shot = _read(data, {})
    axes = _field(shot).samples.axes
    middle, size = [0.5 * (axis[0] + axis[-1]) for axis in axes], max(float(np.ptp(axis)) for axis in axes)
    scale = FIT / size
    centre = [float(f"{-scale * x:.4g}") for x in middle]
    return _read(data, {"scale": float(f"{scale:.4g}"), "centre": centre, "outside": "zero"})


def _read(data: Path, settings: dict[str, object]) -> tuple[dict[str, object], Shot]:
    sampled = to_yaml({"file": str(data.absolute()), **settings})
    try:
        return settings, read_shot(Path("data.yaml"), PROBE.format(sampled=sampled))
    except ShotError as error:  # without the place in a file that nobody has
        raise ShotError(*(re.sub(r"^data\.yaml:\d+:\d+: ", "", each) for each in error.messages)) from None


def _field(shot: Shot) -> Sampled:
    field = shot.motion.flow.members[0].field  # type: ignore[attr-defined]  # along streamlines
    assert isinstance(field, Sampled), "so the probe says"
    return field


def _look(field: Sampled, data: Path, is_globe: bool) -> _Seen:
    samples = field.samples
    flat = None
    if is_globe:
        low, high = np.full(3, -0.5 * FIT), np.full(3, 0.5 * FIT)
    else:
        centre, scale = np.array(field.centre, np.float64), float(field.scale)  # type: ignore[arg-type]
        ends = np.array([[axis[0], axis[-1]] for axis in samples.axes]).T * scale + centre
        low, high = ends.min(axis=0), ends.max(axis=0)
        sides = high - low
        flat = int(sides.argmax()) if sides.max() > FLAT * np.sort(sides)[1] else None
    if flat is not None:
        low[flat], high[flat] = 0.0, 0.0
    nodes = _around(0.5 * FIT) if is_globe else _nodes(low, high)
    speeds = np.linalg.norm(field.velocity(nodes, 0.0), axis=1)
    speeds = speeds[speeds > 0.0]
    if not len(speeds):
        raise UsageError(f"{data}: nothing moves at its first time. Choose another file or variables.")
    return _Seen(
        low,
        high,
        flat,
        is_globe,
        is_dated=bool(samples.date(float(samples.times[0]))),
        seconds=float(samples.times[-1] - samples.times[0]),
        median=float(np.median(speeds)),
        fastest=float(np.percentile(speeds, _BRIGHT)),
    )


def _nodes(low: Floats, high: Floats) -> Floats:
    """Return points (N, 3) on a grid within a box; a few on each axis, one on an axis without a length."""
    counts = [1 if a == b else 24 for a, b in zip(low, high, strict=True)]
    axes = [a + (b - a) * (np.arange(n) + 0.5) / n for a, b, n in zip(low, high, counts, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def _around(radius: float, count: int = 2000) -> Floats:
    """Return points (count, 3), evenly on a sphere: a Fibonacci lattice."""
    y = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    angle = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)
    across = np.sqrt(1.0 - y * y)
    return radius * np.column_stack([across * np.sin(angle), y, across * np.cos(angle)])


def _rows(field: Sampled, seen: _Seen) -> list[list[float]]:
    """Return a line in rows, to and fro, over the plane through the middle of the data that is most crossed,
    or over the plane of data of one level."""
    low, high = seen.low, seen.high
    across = seen.flat
    if across is None:
        planes = []
        for axis in range(3):
            flattened = [np.where(np.arange(3) == axis, 0.5 * (low + high), end) for end in (low, high)]
            planes.append(float(np.abs(field.velocity(_nodes(*flattened), 0.0)[:, axis]).mean()))
        across = int(np.argmax(planes))
    first, second = (axis for axis in (0, 2, 1) if axis != across)
    flattened = [np.where(np.arange(3) == across, 0.5 * (low + high), end) for end in (low, high)]
    speeds = np.abs(field.velocity(_nodes(*flattened), 0.0)).mean(axis=0)
    if speeds[first] > speeds[second]:  # rows lie across the flow, so its lines fill the gaps between them
        first, second = second, first
    point, line = 0.5 * (low + high), []
    shares = np.linspace(0.5 / _ROWS, 1.0 - 0.5 / _ROWS, _ROWS)
    for row, share in enumerate(shares):
        for end in (shares[0], shares[-1]) if row % 2 == 0 else (shares[-1], shares[0]):
            point[first] = low[first] + end * (high[first] - low[first])
            point[second] = low[second] + share * (high[second] - low[second])
            line.append([_rounded(x) for x in point])
    return line


def _camera(seen: _Seen) -> dict[str, object]:
    """Return a camera that shows all of the data: flat data from the front, a globe from the north, others
    from the upper right."""
    sides, middle = seen.high - seen.low, 0.5 * (seen.low + seen.high)
    away, distance = np.array([0.42, 0.3, 0.86]), _AWAY * float(np.linalg.norm(sides))
    if seen.flat == 1:
        away = np.array([0.0, 0.8, 0.6])
    elif seen.flat == 2:
        away = np.array([0.0, 0.0, 1.0])
        distance = _AROUND * max(sides[0] * FOCAL_LENGTH / 36.0, sides[1] * FOCAL_LENGTH / 20.25)
    places = {"position": middle + distance * away, "target": middle}
    return {
        **{name: [round(float(x), 3) for x in place] for name, place in places.items()},
        "focal_length": FOCAL_LENGTH,
    }


def _duration(seconds: float) -> object:
    """Return seconds as shot files say a length of time."""
    for unit, length in (("day", 86400.0), ("h", 3600.0)):
        if seconds >= length:
            return f"{float(f'{seconds / length:.2g}'):g} {unit}"
    return float(f"{seconds:.2g}")


def _rounded(number: float) -> float:
    return float(f"{number:.2g}")
