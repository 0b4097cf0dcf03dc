"""Attributes of variables by the Climate and Forecast (CF) conventions: axes, units, velocities.

References are to CF 1.11: cfconventions.org.
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

EAST, NORTH, UP, TIME = "xyzt"

_STANDARD_AXES = {
    "longitude": EAST,
    "grid_longitude": EAST,
    "projection_x_coordinate": EAST,
    "latitude": NORTH,
    "grid_latitude": NORTH,
    "projection_y_coordinate": NORTH,
    "depth": UP,
    "height": UP,
    "altitude": UP,
    "air_pressure": UP,
    "height_above_mean_sea_level": UP,
    "depth_below_geoid": UP,
    "time": TIME,
}

_AXIS_NAMES = {
    EAST: ("lon", "longitude", "x", "nav_lon", "rlon", "xc", "west_east", "xt_ocean"),
    NORTH: ("lat", "latitude", "y", "nav_lat", "rlat", "yc", "south_north", "yt_ocean"),
    UP: ("z", "lev", "level", "depth", "height", "altitude", "plev", "deptht", "zc", "bottom_top"),
    TIME: ("time", "t", "ocean_time", "time_counter"),
}
_NAMED_AXES = {name: axis for axis, names in _AXIS_NAMES.items() for name in names}

LENGTHS = {"m": 1.0, "km": 1000.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048}
_LENGTH_NAMES = {
    "m": ("metre", "metres", "meter", "meters"),
    "km": ("kilometre", "kilometres", "kilometer", "kilometers"),
    "cm": ("centimetre", "centimetres", "centimeter", "centimeters"),
    "ft": ("foot", "feet"),
}
LENGTHS |= {long: LENGTHS[short] for short, names in _LENGTH_NAMES.items() for long in names}

PRESSURES = {"pa": 1.0, "hpa": 100.0, "mbar": 100.0, "millibar": 100.0, "millibars": 100.0, "mb": 100.0}
PRESSURES |= {"dbar": 1e4, "decibar": 1e4, "kpa": 1000.0}

_DEGREES = re.compile(r"degrees?(_?(east|north|west|south|e|n|true))?", re.IGNORECASE)

SECONDS = {"s": 1.0, "min": 60.0, "h": 3600.0, "d": 86400.0, "week": 604800.0, "ms": 1e-3, "us": 1e-6}
_TIME_NAMES = {
    "s": ("sec", "secs", "second", "seconds"),
    "min": ("mins", "minute", "minutes"),
    "h": ("hr", "hrs", "hour", "hours"),
    "d": ("day", "days"),
    "week": ("weeks",),
    "ms": ("millisecond", "milliseconds", "msec"),
    "us": ("microsecond", "microseconds"),
}
SECONDS |= {long: SECONDS[short] for short, names in _TIME_NAMES.items() for long in names}

CALENDARS = {"standard", "gregorian", "proleptic_gregorian", "julian", "noleap", "365_day", "all_leap"}
CALENDARS |= {"366_day", "360_day", "utc", "tai"}


DATE = re.compile(r"(\d{1,4})-(\d{1,2})-(\d{1,2})(?:[T ](\d{1,2}):(\d{2})(?::(\d{2}))?Z?)?")
"""A date, and maybe a time, of ISO 8601."""


class ConventionError(ValueError):
    """A fact, the rule it breaks, and a remedy, in one line without the name of the file."""


def axis_of(name: str, attributes: Mapping[str, Any]) -> str | None:
    """Return the axis, `x`, `y`, `z` or `t`, that a coordinate measures; None where nothing says it (§4)."""
    standard, units = text(attributes, "standard_name"), text(attributes, "units")
    if standard in _STANDARD_AXES:
        return _STANDARD_AXES[standard]
    axis = text(attributes, "axis").lower()
    if axis in (EAST, NORTH, UP, TIME):
        return axis
    if is_degrees(units) and (match := _DEGREES.fullmatch(units)) and match[2]:
        return EAST if match[2][0].lower() in "ew" else NORTH
    if " since " in units:
        return TIME
    if text(attributes, "positive").lower() in ("up", "down") or units.lower() in PRESSURES:
        return UP
    if "formula_terms" in attributes:  # levels, whose heights a formula gives (§4.3.3)
        return UP
    return _NAMED_AXES.get(name.lower())


def text(attributes: Mapping[str, Any], name: str) -> str:
    """Return an attribute as text; empty where it is missing or no text."""
    value = attributes.get(name, "")
    value = value.decode(errors="replace") if isinstance(value, bytes) else value
    return value.strip() if isinstance(value, str) else ""


def attribute_number(attributes: Mapping[str, Any], name: str, variable: str) -> float | None:
    """Return an attribute that is a number; None where it is missing. Raises ConventionError."""
    value = attributes.get(name)
    if value is None:
        return None
    try:
        number = float(np.asarray(value).reshape(-1)[0])
    except (TypeError, ValueError, IndexError):
        number = float("nan")
    if not np.isfinite(number):
        raise ConventionError(f"attribute {name} of {variable} is {value!r}; it must be a number")
    return number


def is_degrees(units: str) -> bool:
    """Tell whether units are degrees of longitude or latitude."""
    return _DEGREES.fullmatch(units) is not None


_YEAR_ZERO = re.compile(r"0+(?=-)")
_WITHOUT_YEAR_ZERO = ("standard", "gregorian", "julian")  # there it is the year -1


@contextmanager
def _quiet_cftime() -> Iterator[Any]:
    """Give the module cftime, without its warnings about years that CF lacks and files have."""
    import cftime

    with warnings.catch_warnings(action="ignore"):
        yield cftime


@dataclass(frozen=True)
class TimeUnits:
    """The units of a time axis.

    seconds   in one of them
    since     the date at 0 as the file writes it; empty where there is none
    calendar  by its name in CF
    units     as the file writes them
    is_climatology  True if values are means over years (§7.4), also where all are in year 0 (COARDS)
    """

    seconds: float
    since: str
    calendar: str
    units: str
    is_climatology: bool = False

    @classmethod
    def of(cls, attributes: Mapping[str, Any], times: Sequence[float]) -> TimeUnits:
        """Return the units of a time coordinate, of ascending times (§4.4). Raises ConventionError."""
        units, calendar = text(attributes, "units"), text(attributes, "calendar").lower() or "standard"
        calendar = "standard" if calendar == "utc" else calendar  # except leap seconds, which cftime lacks
        unit, _, since = units.partition(" since ")
        name, since = unit.strip().lower(), since.strip()
        if re.fullmatch(r"months?|years?|common_years?|mon|yr", name):
            length = {"360_day": (30, 360), "noleap": (None, 365), "365_day": (None, 365)}.get(calendar)
            days = length[name[0] != "m"] if length else None
            if days is None:
                raise ConventionError(
                    f"its times are in {unit.strip()}, whose length changes in calendar {calendar}; write "
                    "them in days since a date"
                )
            seconds = 86400.0 * days
        elif name in SECONDS:
            seconds = SECONDS[name]
        else:
            shown = f"{units!r} are not units of time" if units else "its times have no units"
            raise ConventionError(f"{shown}; write units such as 'days since 2000-01-01'")
        if calendar not in CALENDARS and since:
            raise ConventionError(
                f"calendar {calendar!r} is unknown; CF has standard, noleap, 360_day and others"
            )
        is_climatology = "climatology" in attributes
        if _YEAR_ZERO.match(since):  # as COARDS marks means over years; models begin in that year and go on
            first, last = (seconds * times[k] / 86400.0 if times else 0.0 for k in (0, -1))
            is_mean = first < 360.0 and last < 720.0
            year = "2001" if is_mean else "-0001" if calendar in _WITHOUT_YEAR_ZERO else "0000"
            since, is_climatology = _YEAR_ZERO.sub(year, since, count=1), is_climatology or is_mean
        return cls(seconds, since, calendar, units, is_climatology)

    def seconds_between(self, other: TimeUnits) -> float:
        """Return the seconds from the date at 0 of these units to that of others (needs cftime)."""
        if self.since == other.since or not (self.since and other.since):
            return 0.0
        if self.calendar != other.calendar:
            raise ConventionError(f"calendars {self.calendar} and {other.calendar} differ")
        try:
            with _quiet_cftime() as cftime:
                begin = cftime.num2date(0, f"days since {other.since}", other.calendar)
                return float(cftime.date2num(begin, f"seconds since {self.since}", self.calendar))
        except (ValueError, OverflowError):
            fact = f"{self.since!r} or {other.since!r} is not a date of its calendar, {self.calendar}"
            raise ConventionError(f"{fact}; correct the units of its times") from None

    def number_of(self, date: str) -> float:
        """Return the number of a date of ISO 8601 in the calendar of the file (needs cftime).

        Raises ConventionError where the file has no dates, or its calendar not that one.
        """
        match = DATE.fullmatch(date)
        if match is None:
            raise ConventionError(f"{date!r} is not a date; write one such as 2019-03-01 or 2019-03-01T06:00")
        if not self.since:
            raise ConventionError(f"its times ({self.units}) have no dates; write start in seconds")
        parts, unit = [int(part or 0) for part in match.groups()], self.units.partition(" since ")[0]
        try:
            with _quiet_cftime() as cftime:
                found = cftime.datetime(*parts, calendar=self.calendar)
                return float(cftime.date2num(found, f"{unit} since {self.since}", self.calendar))
        except (ValueError, OverflowError):
            raise ConventionError(f"{date} is not a date of its calendar, {self.calendar}") from None

    def date(self, number: float) -> str:
        """Return the date and time of a number; empty where the file has no date, or cftime is missing.

        Means over years have `-` in place of the year (ISO 8601:2000, 5.2.1.3): `--01-16 12:00:00`.
        """
        unit = self.units.partition(" since ")[0]
        try:
            with _quiet_cftime() as cftime:
                date = cftime.num2date(number, f"{unit} since {self.since}", self.calendar)
        except (ImportError, ValueError, OverflowError):
            return ""
        if not self.since:
            return ""
        return str(date) if not self.is_climatology else "-" + str(date)[str(date).index("-", 1) :]


def duration(words: str) -> float:
    """Return the seconds of a length of time such as `1 day` or `6 h`. Raises ValueError."""
    match = re.fullmatch(r"\s*([-+]?[0-9]*\.?[0-9]+(?:e[-+]?[0-9]+)?)\s*([a-z]+)\s*", words, re.IGNORECASE)
    if match is None or match[2].lower() not in SECONDS:
        raise ValueError(f"{words!r} is not a length of time; write a number of seconds, or such as 1 day")
    return float(match[1]) * SECONDS[match[2].lower()]


def speed_factor(units: str) -> tuple[float, bool]:
    """Return the factor from units of speed to m/s, and False; or to radians per second, and True.

    Raises ConventionError for units of anything else.
    """
    plain = units.strip().lower().replace("**", "").replace("^", "")
    if plain in ("knot", "knots", "kt", "kts"):
        return 1852.0 / 3600.0, False
    parts = re.fullmatch(r"([a-z_]+)\s*(?:/\s*([a-z]+)|(?:[.*·]|\s)?\s*([a-z]+)\s*-1)", plain)
    length, time = (parts[1], parts[2] or parts[3]) if parts else ("", "")
    if time in SECONDS and length in LENGTHS:
        return LENGTHS[length] / SECONDS[time], False
    if time in SECONDS and (is_degrees(length) or length in ("deg", "rad", "radian", "radians")):
        return (1.0 if length.startswith("rad") else math.radians(1.0)) / SECONDS[time], True
    raise ConventionError(
        f"{units!r} are not units of a velocity; correct its attribute units, for example to 'm s-1', or "
        "name other variables"
    )


_DIRECTIONS = {"eastward": EAST, "x": EAST, "northward": NORTH, "y": NORTH, "upward": UP, "downward": "-z"}
_NO_VELOCITY = ("stress", "flux", "transport", "momentum", "wave", "acceleration", "tendency", "gradient")
_USUAL_NAMES = (
    ("uo", "vo", "wo"),
    ("ua", "va", "wa"),
    ("water_u", "water_v", "water_w"),
    ("ugos", "vgos", ""),
    ("ugosa", "vgosa", ""),
    ("u10", "v10", ""),
    ("uas", "vas", ""),
    ("uwnd", "vwnd", ""),
    ("u", "v", "w"),
    ("vx", "vy", "vz"),
    ("velocity_x", "velocity_y", "velocity_z"),
    ("u-component", "v-component", "w-component"),
)


def velocity_direction(standard_name: str) -> tuple[str, str] | None:
    """Return the family of a standard name of a component, and its direction; None for all other names.

    `eastward_wind` and `northward_wind` are of one family, and so is `upward_air_velocity`.
    """
    if any(word in standard_name for word in _NO_VELOCITY):
        return None
    if not re.search(r"(?:^|_)(?:wind|velocity)(?:_|$)", standard_name):
        return None
    words = standard_name.split("_")
    turns = [word for word in words if word in _DIRECTIONS]
    if len(turns) != 1:
        return None
    rest = "_".join(word for word in words if word != turns[0])
    return {"air_velocity": "wind"}.get(rest, rest), _DIRECTIONS[turns[0]]


def velocities_among(standard_names: Mapping[str, str]) -> list[dict[str, str]]:
    """Return what can be a velocity: for each the variables of its components, `x`, `y`, and maybe `z`.

    standard_names  of all variables with axes, by name; empty where they have none
    """
    families: dict[str, dict[str, list[str]]] = {}
    for name, standard in standard_names.items():
        if (known := velocity_direction(standard)) is not None and known[1] in _DIRECTIONS.values():
            families.setdefault(known[0], {}).setdefault(known[1], []).append(name)
    found = []
    for components in families.values():
        if EAST in components and NORTH in components:
            vertical = components.get(UP, [])[:1]
            for east, north in zip(components[EAST], components[NORTH], strict=False):
                found.append({EAST: east, NORTH: north} | ({UP: vertical[0]} if vertical else {}))
    if found:
        return found
    lower = {name.lower(): name for name in standard_names}
    for names in _USUAL_NAMES:
        here = {axis: lower[name] for axis, name in zip("xyz", names, strict=True) if name in lower}
        if EAST in here and NORTH in here:
            found.append(here)
    return found


def standard_height(pressure: Sequence[float]) -> list[float]:
    """Return heights (m) of pressures (Pa) in the standard atmosphere (ISO 2533), up to 20 km."""
    heights = []
    for p in pressure:
        p = max(float(p), 1.0)
        below = 44330.77 * (1.0 - (p / 101325.0) ** 0.190263)
        heights.append(below if p >= 22632.06 else 11000.0 + 6341.62 * math.log(22632.06 / p))
    return heights
