"""The grid of a wedge: values from `--vary name=first:last:count`, or `name=one,two,three`."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

from pipeline.errors import UsageError
from pipeline.production.store.store import key_of
from pipeline.shot.yaml.named_files import shown

OPTION = "--vary"
MOST_CELLS = 100
"""Cells of a wedge at most, without --yes."""

MOST_AT_ALL = 10_000

_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_STEPS = re.compile(rf"\s*({_NUMBER}):({_NUMBER}):(\d+)\s*")
_LONGEST_NAME = 100
"""Letters of a cell's folder; the end of a longer name is replaced by a digest."""


@dataclass(frozen=True)
class Variation:
    """The name of a value in a shot, and the values that it takes.

    values  YAML, as in a shot file
    said    what the user wrote, for messages
    """

    name: str
    values: tuple[str, ...]
    said: str

    @classmethod
    def parse(cls, text: str) -> Variation:
        """Parse `flows.0.vortex.strength=1:3:5`, five values from 1 to 3, or `look=clay,glaze`.

        Raises UsageError, with the option, for what is neither, for fewer than two values and for equal ones.
        """
        name, equals, rest = (part.strip() for part in text.partition("="))
        place = f"{OPTION} {shown(text)}"
        if not (name and equals and rest):
            raise UsageError(
                f"{place}: this varies nothing. Write name=first:last:count, such as "
                "flows.0.vortex.strength=1:3:5, or name=value,value."
            )
        steps = _STEPS.fullmatch(rest)
        values = _steps(place, *steps.groups()) if steps else _listed(rest)
        if len(values) < 2:
            raise UsageError(
                f"{place}: one value; a wedge needs at least two (--set sets one). Write "
                "name=first:last:count, or values with commas between them."
            )
        if len(set(values)) < len(values):
            twice = next(value for value in values if values.count(value) > 1)
            raise UsageError(f"{place}: {shown(twice)} is listed twice. Remove one.")
        return cls(name, values, text)

    def setting(self, value: str) -> str:
        return f"{self.name}={value}"


@dataclass(frozen=True)
class Cell:
    """One combination of values, in the order of the variations.

    folder   the name of its folder, from its values: the same cell of another wedge has the same
    caption  short names and values, below its picture
    """

    settings: tuple[str, ...]
    folder: str
    caption: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Grid:
    """Every combination of the values of variations; those of the last change fastest."""

    variations: tuple[Variation, ...]

    @classmethod
    def parse(cls, texts: Sequence[str], many: bool = False) -> Grid:
        """`many` allows more than MOST_CELLS. Raises UsageError, with the option that is wrong."""
        if not texts:
            raise UsageError(
                f"a wedge needs {OPTION}: name what varies, such as {OPTION} flows.0.vortex.strength=1:3:5"
            )
        variations = tuple(map(Variation.parse, texts))
        names = [variation.name for variation in variations]
        for i, name in enumerate(names):
            if name in names[:i]:
                raise UsageError(
                    f"{OPTION} {shown(texts[i])}: {shown(name)} is varied twice; list all its values in one"
                )
        grid = cls(variations)
        if len(grid) > (MOST_AT_ALL if many else MOST_CELLS):
            counts = " × ".join(str(len(variation.values)) for variation in variations)
            remedy = "take fewer values" if many else "take fewer values, or add --yes if you mean it"
            raise UsageError(
                f"{OPTION} {shown(texts[-1])}: that makes {counts} = {len(grid)} cells, and a wedge has at "
                f"most {MOST_AT_ALL if many else MOST_CELLS}; {remedy}"
            )
        return grid

    def __len__(self) -> int:
        return math.prod(len(variation.values) for variation in self.variations)

    def __iter__(self) -> Iterator[Cell]:
        short = _short_names([variation.name for variation in self.variations])
        taken: set[str] = set()
        for values in product(*(variation.values for variation in self.variations)):
            pairs = list(zip(self.variations, values, strict=True))
            folder = _folder([variation.setting(value) for variation, value in pairs], taken)
            taken.add(folder.lower())
            settings = tuple(variation.setting(value) for variation, value in pairs)
            yield Cell(settings, folder, tuple(zip(short, values, strict=True)))

    @property
    def columns(self) -> int | None:
        """Columns of a sheet whose rows go through the last variation; None if there is only one."""
        return len(self.variations[-1].values) if len(self.variations) > 1 else None

    @property
    def name(self) -> str:
        """The name of its sheets, from the names of the values."""
        return _folder([variation.name for variation in self.variations], set())


def _steps(place: str, first: str, last: str, count: str) -> tuple[str, ...]:
    """Return `count` numbers at equal distances, each with at most six digits."""
    many = int(count[:9])
    if many > MOST_AT_ALL:
        raise UsageError(f"{place}: {count} values are too many; a wedge has at most {MOST_AT_ALL} cells")
    if many == 0:
        raise UsageError(f"{place}: no values; the last number is how many, 2 or more")
    begin, end = float(first), float(last)
    if not (math.isfinite(begin) and math.isfinite(end)):
        raise UsageError(f"{place}: one of the numbers is too large; use smaller ones")
    shares = (i / max(1, many - 1) for i in range(many))
    return tuple(f"{begin * (1.0 - share) + end * share:.6g}" for share in shares)


def _listed(text: str) -> tuple[str, ...]:
    """Return the parts between commas outside of brackets and quotes."""
    parts, depth, quote = [""], 0, ""
    for letter in text:
        if quote:
            quote = "" if letter == quote else quote
        elif letter in "'\"":
            quote = letter
        else:
            depth += (letter in "[{(") - (letter in "]})")
        if letter == "," and depth == 0 and not quote:
            parts.append("")
        else:
            parts[-1] += letter
    return tuple(part.strip() for part in parts if part.strip())


def _short_names(names: Sequence[str]) -> list[str]:
    """Return for each name the shortest end that differs from the others and begins with an identifier."""
    parts = [name.split(".") for name in names]

    def short(each: Sequence[str], length: int) -> tuple[str, ...]:
        while length < len(each) and (each[-length] == "keys" or not each[-length].isidentifier()):
            length += 1
        return tuple(each[-length:])

    length = 1
    while len({short(each, length) for each in parts}) < len(names):
        length += 1
    return [".".join(short(each, length)) for each in parts]


def _folder(settings: Sequence[str], taken: set[str]) -> str:
    """Return a folder name, valid on any system and different from those `taken`."""
    plain = ",".join(re.sub(r"[^\w.=+-]+", "_", setting) for setting in settings)
    if len(plain) > _LONGEST_NAME or plain.lower() in taken:
        return f"{plain[: _LONGEST_NAME - 9]}~{key_of(list(settings))[:8]}"
    return plain
