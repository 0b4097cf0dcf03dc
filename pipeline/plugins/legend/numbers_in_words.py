"""Numbers, lengths and dates as legends write them."""

from __future__ import annotations

import math
from itertools import pairwise

MONTHS = (
    *("January", "February", "March", "April", "May", "June"),
    *("July", "August", "September", "October", "November", "December"),
)

_NICE = (1.0, 2.0, 5.0, 10.0)
MOST_OF_HOURS, MOST_OF_DAYS = 60.0, 20 * 1440.0
"""Minutes from frame to frame from which clocks show no hours, and no days: they would flicker."""

MINUS = "\N{EN DASH}"
"""In place of a minus sign, which the font of legends lacks."""

IN_FONT = str.maketrans({"\N{MINUS SIGN}": MINUS, "\N{SUPERSCRIPT MINUS}": MINUS, "‰": f"1e{MINUS}3"})
"""Letters that the font lacks, and what is written in their place."""


def marks(low: float, high: float, is_logarithmic: bool) -> list[tuple[float, float]]:
    """Return three to five round numbers of a range, with their places from 0 to 1."""
    if is_logarithmic:
        return _logarithmic_marks(low, high)
    for parts in (4.0, 6.0, 8.0):
        step = _nice_step((high - low) / parts)
        first, last = math.ceil(low / step - 1e-6), math.floor(high / step + 1e-6)
        if last - first >= 2:
            break
    return [(n * step, (n * step - low) / (high - low)) for n in range(first, last + 1)]


def _nice_step(least: float) -> float:
    power = 10.0 ** math.floor(math.log10(least))
    return power * next(nice for nice in _NICE if nice * power >= least * (1.0 - 1e-9))


def _logarithmic_marks(low: float, high: float) -> list[tuple[float, float]]:
    decades = math.log10(high / low)
    digits = (1.0,) if decades > 2.5 else (1.0, 3.0) if decades > 1.2 else (1.0, 2.0, 5.0)
    found = [
        digit * 10.0**power
        for power in range(math.floor(math.log10(low)) - 1, math.ceil(math.log10(high)) + 1)
        for digit in digits
    ]
    inside = [value for value in found if low * (1.0 - 1e-9) <= value <= high * (1.0 + 1e-9)]
    every = -(-len(inside) // 5)
    chosen = inside[::every] if len(inside) > 2 else [value for value, _ in marks(low, high, False)]
    return [(value, math.log(value / low) / math.log(high / low)) for value in chosen]


def written(value: float, places: list[tuple[float, float]]) -> str:
    """Return a number of a scale with as many digits as the scale needs."""
    numbers = [number for number, _ in places]
    if value == 0.0 or abs(value) < 1e-12 * max(map(abs, numbers)):
        return "0"
    largest = max(map(abs, numbers))
    if not 1e-4 <= largest < 1e6:
        digits, power = f"{value:.2e}".split("e")
        text = f"{digits.rstrip('0').rstrip('.')}e{int(power)}"
        return text.replace("-", MINUS)
    least = 1e-3 * min([abs(b - a) for a, b in pairwise(numbers)] or [largest])
    decimals = next(d for d in range(13) if d == 12 or all(abs(round(n, d) - n) <= least for n in numbers))
    return f"{value:.{decimals}f}".replace("-", MINUS)


def date_text(date: str, later: str) -> str:
    """Return a date as a legend shows it.

    date, later  `2003-08-02 06:00:00`, of a frame and the next one: the finer their step, the more is shown;
                 `--08-02 06:00:00` in means over years, which have months alone
    """
    (year, month, day, time), minutes = _parts(date), _minutes_between(date, later)
    if year is None:
        return MONTHS[month - 1]
    name = MONTHS[month - 1][:3]
    if minutes >= MOST_OF_DAYS:
        return f"{name} {year}"
    return f"{day} {name} {year}" + f"  {time[:5]}" * (minutes < MOST_OF_HOURS and len(time) >= 5)


def _parts(date: str) -> tuple[int | None, int, int, str]:
    days, _, time = date.partition(" ")
    year, month, day = days.rsplit("-", 2)
    return None if year == "-" else int(year), int(month), int(day), time


def _minutes_between(date: str, later: str) -> float:
    """Return about how many minutes are between two dates, of any calendar."""
    ends = []
    for year, month, day, time in map(_parts, (date, later)):
        hours, minutes = (int(each) if each else 0 for each in (time[:2], time[3:5]))
        ends.append(60.0 * (24.0 * (365.25 * (year or 0) + 30.44 * month + day) + hours) + minutes)
    return abs(ends[1] - ends[0])


def round_length(most: float, metres: float | None, unit: str) -> tuple[float, str]:
    """Return the longest round length of at most `most` units, in units, and its text.

    metres  the length of a unit; None where it is unknown
    """
    known = metres or 1.0
    power = 10.0 ** math.floor(math.log10(most * known))
    length = power * max(nice for nice in (1.0, 2.0, 5.0) if nice * power <= most * known)
    if metres is None:
        return length, f"{length:g} {'unit' if (length, unit) == (1.0, 'units') else unit}"
    for size, name in ((1000.0, "km"), (1.0, "m"), (0.01, "cm")):
        if length >= size:
            return length / known, f"{length / size:,.0f}".replace(",", " ") + f" {name}"
    return length / known, f"{1000.0 * length:g} mm"
