"""New shots of measured or simulated velocities in files: what they draw out of seeds."""

from __future__ import annotations

import os
import re
import shlex
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from flowsculpt import MissingInputError, UsageError
from flowsculpt.api import ShotError
from flowsculpt.api.files import InputFile
from flowsculpt.api.flows import Sampled
from flowsculpt.api.frames import Show
from flowsculpt.api.meshes import Floats
from flowsculpt.api.shots import PRESETS, Shot, read_shot, to_yaml
from flowsculpt.pipeline.plugins.authoring.land_pictures import around_globe, land_at, over_plate, write_land
from flowsculpt.pipeline.plugins.authoring.new_files import Content
from flowsculpt.pipeline.plugins.authoring.sequence_shots import MARKS
from flowsculpt.pipeline.plugins.authoring.shot_templates import FIT, choice, title_of

SECONDS = 10.0
"""Of the shot: all times of the data pass in it, or else a point of median speed crosses the data."""

FLAT = 20.0
"""Times as long as the others that an axis along which nothing changes may be, as of data of one level."""

GLOBE = 0.9
"""Share of a circle that longitudes cover, from which data lie on a sphere."""

HEIGHT = 0.22
"""Least height of data with levels, in their size: an atmosphere as it is would be as thin as paper."""

COLOURS = ["#2c5c9e", "#2b9fa0", "#9ccd74", "#ffdc62"]
"""A palette whose dark end, too, stands out before the dark stage."""

_REACH = 0.4  # of streamlines at the speed of the end of the palette, in sizes of the data
_TURNS = 40  # of seeds, on a globe: nearer than seeds on a turn, since most flows go around
_LINES, _LINES_OF_GLOBE, _PATHS = 800, 1000, 360
_DENSER = 3.0  # times as many lines over data of one level, at most, where others would begin on land
_PLATE = 1.06  # sides of the plate below data of one level, over theirs
_ONE_WAY = 0.8  # share of what crosses a plane, less what returns, from which paths begin where it enters
_UNLIKELY = 200.0  # times the median that speeds at the end of the palette are
_BRIGHT = 98.0  # per cent of the speeds that are below the end of the palette

SHOT = """\
title: {title}
frames: 1-{frames}
{subject}
look:
  material: clay
  measure: {{values: {{range: {range}, colours: {colours}}}}}  # or viridis, thermal, another list
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


def _require_files(data: Path) -> None:
    """Raise MissingInputError for a file, or one of a sequence, that is not there or is a Git LFS pointer."""
    if not data.exists() and (shape := MARKS.sub("*", data.name)) != data.name:
        fact = "file not found; * stands for the numbers of a sequence"
        raise MissingInputError(f"{data}: {fact}. Write {shape}, in quotes.")
    if "**" in data.name:  # which is not a sequence
        return
    files = [*data.parent.glob(data.name)] if "*" in data.name else [data]
    if not files:
        raise MissingInputError(f"no file matches {data}. Correct the name.")
    for file in files:
        if not file.is_dir():
            InputFile(file, 1 << 42).size()


@dataclass(frozen=True)
class _Seen:
    """The facts about data that a new shot follows.

    low, high  (3,) corners of where it is, units
    flat       the axis along which nothing changes, 0 to 2; None of data in space
    is_globe   True if it goes around a sphere
    azimuth    of the side of a globe that moves most, degrees
    is_dated   True if its times are dates
    seconds    from its first time to its last; 0 where the velocities do not change
    moving     share of the places where anything moves
    median     of the speeds, units per second of the data
    fastest    _BRIGHT % of the speeds are slower, units per second of the data
    """

    low: Floats
    high: Floats
    flat: int | None
    is_globe: bool
    azimuth: int
    is_dated: bool
    seconds: float
    moving: float
    median: float
    fastest: float

    @property
    def size(self) -> float:
        return float((self.high - self.low).max())

    @property
    def lines(self) -> int:
        if self.is_globe:
            return _LINES_OF_GLOBE
        if self.flat is not None:
            return round(_LINES * min(1.0 / self.moving, _DENSER))
        return _LINES if self.seconds else _PATHS

    @property
    def is_in_space(self) -> bool:
        """True of data that need nothing to lie on."""
        return self.flat is None and not self.is_globe


def shot_of_data(
    data: Path, name: str, all_levels: bool = False
) -> tuple[str, dict[Path, Content], list[str]]:
    """Return the text of a new shot of a file of velocities, files beside it, and lines to tell about it.

    all_levels  True shows all depths of a sea; else one that is wide and thin is a map of its surface

    Raises UsageError where nothing moves in it, MissingInputError where a file is not there, FrameError for
    velocities that are not finite, and what `read_shot` raises where it cannot be read.
    """
    _require_files(data)
    reference = Path(os.path.relpath(data.absolute(), Show().folder.resolve())).as_posix()
    settings, shot = _placed(data, all_levels)
    field = _field(shot)
    seen = _look(field, data, is_globe="map" in settings)
    pace, settings = _paced(field, seen, settings)
    is_bent = any("curvilinear" in note for note in shot.notes)
    land, picture = _land(field, seen, is_bent), f"{name}_land.png"

    def text_with(named: str, land_file: str = "") -> str:
        legend: dict[str, object] = {"colours": {"place": "lower right"}}
        if seen.is_dated:
            legend["clock"] = {"place": "upper right"}
        return SHOT.format(
            title=title_of(name),
            frames=round(24.0 * SECONDS),
            subject=_subject(data, seen, _lines(field, seen, pace, {"file": named, **settings}), land_file),
            range=to_yaml([0, _rounded(seen.fastest * _in_data(field, pace))]),
            colours=to_yaml(COLOURS),
            camera=to_yaml(_camera(seen)),
            lights=choice(PRESETS["lights"], "studio"),
            legend=to_yaml(legend),
        )

    shot = read_shot(Path(f"{name}.yaml"), text_with(str(data.absolute())))  # shots/ may not be there yet
    remarks = [f"{data} stays where it is; the shot names it {reference}", *shot.notes]
    if seen.fastest > _UNLIKELY * seen.median:
        remarks.append(
            f"{data}: {100.0 - _BRIGHT:g}% of the speeds are over {seen.fastest / seen.median:.3g} times the "
            "median; if a number such as -999 marks what is missing, name it in _FillValue"
        )
    if "at" in settings:
        level = to_yaml(settings["at"])
        remarks.append(
            f"{data}: its depths are a thin layer; the shot is a map of the one nearest the surface, "
            f"at: {level}. Write another index there, or begin again with --all-levels"
        )
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
    subject = {
        "velocity": [{"sampled": sampled}],
        "values": "speed",
        "count": seen.lines,
        "radius": _rounded(seen.size / (280.0 if seen.is_in_space else 380.0)),
        "taper": 0.3,
        "max_edge_length": _rounded(seen.size / 50.0),
    }
    if not seen.seconds:
        return {**subject, "begin": -1, "path_lines": seeds}
    length = _rounded(_REACH * seen.size / (seen.fastest * pace))
    return {**subject, "length": length, "stream_lines": seeds}


def _subject(data: Path, seen: _Seen, lines: dict[str, object], land_file: str) -> str:
    """Return the lines of the shot file that say what is shown: data of one level lie on something."""
    indent = "  " if seen.is_in_space else "    "
    written = [f"{indent}{name}: {to_yaml(value)}" for name, value in lines.items()]
    written[1] += f"  # or {{variable: NAME}}; flowsculpt data {shlex.quote(data.name)} lists them"
    written[2] += "  # seeds along the curve below; many more need more rows or turns there"
    if seen.is_in_space:
        return "\n".join(["subject:", *written])
    return "\n".join(["subjects:", "  flow:", *written, f"  base: {to_yaml(_base(seen, land_file))}"])


def _land(field: Sampled, seen: _Seen, is_bent: bool) -> np.ndarray | None:
    """Return a picture of land on a globe or a plate; None without land.

    Around a bent grid nothing moves, and that is not land: only within the convex hull of what moves is any.
    """
    if seen.is_globe:
        return land_at(field, around_globe(0.5 * seen.size))
    if seen.flat not in (1, 2):
        return None
    points = over_plate(0.5 * (seen.low + seen.high), _PLATE * (seen.high - seen.low), seen.flat == 1)
    inside = np.all((points >= seen.low) & (points <= seen.high), axis=-1)
    if is_bent:
        nodes, angles = _nodes(seen.low, seen.high), np.radians(np.arange(0, 360, 5))
        sides = np.stack([np.cos(angles), 0.0 * angles, np.sin(angles)])
        ends = (nodes[field.velocity(nodes, 0.0).any(axis=1)] @ sides).max(axis=0)
        inside &= (points @ sides <= ends - seen.size / 24.0).all(axis=-1)  # its rim is uneven
    return land_at(field, points, np.asarray(inside))


def _base(seen: _Seen, land_file: str) -> dict[str, object]:
    """Return the dark subject on which lines lie: a globe, or a plate below data of one level."""
    even = {"max_edge_length": 0.04} if land_file else "off"  # previews show pictures by their vertices
    look: dict[str, object] = {"material": "clay", "colour": land_file or [0.03, 0.033, 0.04]}
    if land_file:
        look["projection"] = {"kind": "spherical"}
    if land_file and not seen.is_globe:
        wide, faces = _PLATE * (seen.high - seen.low)[0], "xyz"[seen.flat or 0]
        look["projection"] = {"kind": "planar", "axis": faces, "scale": _rounded(wide)}
    if seen.is_globe:
        return {"solid": "icosphere", "radius": _rounded(0.4975 * seen.size), "resample": even, "look": look}
    thin = 0.02 * seen.size
    sides = np.where(np.arange(3) == seen.flat, thin, _PLATE * (seen.high - seen.low))
    place = 0.5 * (seen.low + seen.high) - (0.5 * thin + seen.size / 300.0) * np.eye(3)[seen.flat or 0]
    placed = {"size": [_rounded(x) for x in sides], "place": [_rounded(x) for x in place]}
    return {"solid": "box", **placed, "resample": even, "look": look}


def _in_data(field: Sampled, pace: float) -> float:
    """Return the factor from units per second of the data to the unit in which its speed is shown."""
    metre = field.samples.metre
    is_as_is = metre is not None and not field.samples.is_paced
    return pace if is_as_is else 1.0 / ((metre or 1.0) * float(field.scale))  # type: ignore[arg-type]


def _placed(data: Path, all_levels: bool) -> tuple[dict[str, object], Shot]:
    """Return the settings that make the data FIT units large, and a shot with them.

    Data that go around the earth are on a sphere. Other data of one level lie as a map does, with north away
    from the camera, and so does the surface of a sea. Data of several levels are at least HEIGHT of their
    size high.
    """
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
        sides = np.array([np.ptp(axis) for axis in _field(shot).samples.axes])
        if _flat(sides) == 2:
            return _read(data, settings | {"up": "z"})
        is_thin, surface = sides[1] < HEIGHT * sides.max(), _field(shot).samples.surface
        if is_thin and surface is not None and not all_levels:
            return _read(data, settings | {"at": {surface[0]: surface[1]}})
        if _flat(sides) is None and is_thin:
            return _read(data, settings | {"exaggerate": _rounded(HEIGHT * sides.max() / sides[1])})
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
    samples, flat = field.samples, None
    low, high = np.full(3, -0.5 * FIT), np.full(3, 0.5 * FIT)
    if not is_globe:
        centre, scale = np.array(field.centre, np.float64), float(field.scale)  # type: ignore[arg-type]
        ends = np.array([[axis[0], axis[-1]] for axis in samples.axes]).T * scale + centre
        low, high = ends.min(axis=0), ends.max(axis=0)
        flat = _flat(high - low)
        least = min(map(np.ptp, samples.axes))
        if sum(len(axis) == 2 and np.ptp(axis) > FLAT * least for axis in samples.axes) > 1:
            raise UsageError(f"{data}: its velocities change along one axis alone. Choose other data.")
    if flat is not None:
        low[flat], high[flat] = 0.0, 0.0
    nodes = _around(0.5 * FIT) if is_globe else _nodes(low, high)
    speeds = np.linalg.norm(field.velocity(nodes, 0.0), axis=1)
    sides = np.radians(np.arange(-180, 180, 15))
    seen_of = np.maximum(nodes @ np.stack([np.sin(sides), 0.0 * sides, np.cos(sides)]), 0.0)
    azimuth = round(np.degrees(sides[np.argmax(speeds @ seen_of)]))
    moving = float((speeds > 0.0).mean())
    speeds = speeds[speeds > 0.0]
    if not len(speeds):
        raise UsageError(f"{data}: nothing moves at its first time. Choose another file or variables.")
    return _Seen(
        low,
        high,
        flat,
        is_globe,
        azimuth,
        is_dated=bool(samples.date(float(samples.times[0]))),
        seconds=float(samples.times[-1] - samples.times[0]),
        moving=moving,
        median=float(np.median(speeds)),
        fastest=float(np.percentile(speeds, _BRIGHT)),
    )


def _flat(sides: Floats) -> int | None:
    """Return the axis along which nothing changes; None of data in space."""
    return int(sides.argmax()) if sides.max() > FLAT * np.sort(sides)[1] else None


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
    """Return a line in rows, to and fro, over the plane of data of one level, or over planes of other data.

    Streamlines begin on level planes; paths on the plane that is most crossed, where the flow comes from.
    """
    across, sides = seen.flat, seen.high - seen.low
    if across is not None:
        levels = [0.5]
    elif seen.seconds:
        across, levels = 1, _shares(sides[1] / np.cbrt(sides.prod() / seen.lines))
    else:
        flows = [_through(field, seen, axis)[:, axis] for axis in range(3)]
        across = int(np.argmax([np.abs(flow).mean() for flow in flows]))
        ahead = flows[across].mean() / np.abs(flows[across]).mean()
        levels = [0.5 if abs(ahead) < _ONE_WAY else 0.03 if ahead > 0.0 else 0.97]
    first, second = (axis for axis in (0, 2, 1) if axis != across)
    speeds = np.abs(_through(field, seen, across)).mean(axis=0)
    if speeds[first] > speeds[second]:  # rows lie across the flow, so its lines fill the gaps between them
        first, second = second, first
    apart = float(np.sqrt(sides[first] * sides[second] * len(levels) / seen.lines))
    rows, ends = _shares(sides[second] / apart), _shares(sides[first] / apart)
    line = []
    for level in levels:
        point = seen.low + level * sides
        for row, share in enumerate(rows):
            for end in (ends[0], ends[-1]) if row % 2 == 0 else (ends[-1], ends[0]):
                point[first] = seen.low[first] + end * sides[first]
                point[second] = seen.low[second] + share * sides[second]
                line.append([_rounded(x) for x in point])
    return line


def _shares(count: float) -> list[float]:
    """Return the middles of about so many equal parts of 1, at least two."""
    parts = max(2, round(count))
    return [(part + 0.5) / parts for part in range(parts)]


def _through(field: Sampled, seen: _Seen, axis: int) -> Floats:
    """Return velocities (N, 3) on the plane across an axis through the middle of the data."""
    ends = [
        np.where(np.arange(3) == axis, 0.5 * (seen.low + seen.high), end) for end in (seen.low, seen.high)
    ]
    return field.velocity(_nodes(*ends), 0.0)


def _camera(seen: _Seen) -> dict[str, object]:
    """Return a camera that goes slowly around the data: above a map, before upright data, and where a globe
    moves most."""
    if seen.is_globe:
        return {"azimuth": seen.azimuth, "elevation": 18, "move": {"arc": 50}}
    if seen.flat is None:
        return {"azimuth": 28, "elevation": 20, "move": {"arc": 40}}
    direction = {"azimuth": 90 if seen.flat == 0 else 0, "elevation": 44 if seen.flat == 1 else 6}
    return {**direction, "margin": 0.07, "move": {"arc": 20, "push": 0.1}}


def _duration(seconds: float) -> object:
    """Return seconds as shot files say a length of time."""
    for unit, length in (("day", 86400.0), ("h", 3600.0)):
        if seconds >= length:
            return f"{float(f'{seconds / length:.2g}'):g} {unit}"
    return float(f"{seconds:.2g}")


def _rounded(number: float) -> float:
    return float(f"{number:.2g}")
