"""Colours in shot files: three numbers of linear Rec.709, or a hexadecimal number of sRGB in quotes."""

from __future__ import annotations

import re
from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from pipeline.errors import shortened
from pipeline.shot.documents.fields import SchemaKeywords, ZeroToOne, is_number
from pipeline.shot.yaml.plain_text import in_yaml
from pipeline.shot.yaml.validation import bad_value, finding

HEX_PATTERN = r"^#([0-9a-fA-F]{3}|[0-9a-fA-F]{6})$"
"""JSON Schema pattern of a colour such as #c04020 or #c42."""

WORDS = {
    "black": "'#141414'",
    "blue": "'#2850b4'",
    "brown": "'#6e4628'",
    "gray": "'#808080'",
    "green": "'#328c46'",
    "grey": "'#808080'",
    "orange": "'#dc7828'",
    "pink": "'#e696aa'",
    "purple": "'#6e3c96'",
    "red": "'#b4281e'",
    "white": "'#e6e6e6'",
    "yellow": "'#e1be32'",
}
"""Colours that messages propose for words of daily English, as a shot file writes them."""

_HEX = re.compile(r"#?([0-9a-fA-F]+)")
_RGB = re.compile(r"rgba?\(\s*(\d+)\s*,\s*(\d+)\s*,\s*(\d+)")


def is_hex(value: Any) -> bool:
    """Tell whether a value is meant as a colour of sRGB: text that begins with #."""
    return isinstance(value, str) and value.startswith("#")


def linear_of(text: str) -> list[float]:
    """Return linear Rec.709 of a hexadecimal colour of sRGB. Raises an error for pydantic for other text."""
    digits = text.removeprefix("#")
    if not re.fullmatch(HEX_PATTERN, text):
        raise bad_value(_fault(text))
    if len(digits) == 3:
        digits = "".join(2 * digit for digit in digits)
    return [_linear(int(digits[i : i + 2], 16) / 255.0) for i in (0, 2, 4)]


def _linear(value: float) -> float:
    """Decode sRGB (IEC 61966-2-1), rounded so that a colour has the same digits on every machine."""
    return round(value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4, 9)


def _fault(text: str) -> str:
    if (meant := WORDS.get(text.lower())) is not None:
        return f"a colour is no word. Write {meant}, or red, green and blue from 0 to 1."
    match, rgb, quote = _HEX.fullmatch(text), _RGB.match(text), shortened(text)
    if rgb:
        return f"a colour of sRGB is written '{_hex([int(part) for part in rgb.groups()])}', in quotes."
    if match and len(match[1]) in (4, 8):
        count = 3 * len(match[1]) // 4
        return f"{quote} has {len(match[1])} digits; colours have no alpha. Write '#{match[1][:count]}'."
    if match and text.startswith("#"):
        return f"{quote} has {len(match[1])} digits; it must have 3 or 6. Write it as '#c04020'."
    if match and len(match[1]) in (3, 6):
        return f"a colour of sRGB begins with #. Write '#{match[1]}', in quotes."
    return f"{quote} is no colour. Write red, green, blue from 0 to 1, as [0.5, 0.2, 0.1], or '#c04020'."


def _hex(values: list[int]) -> str:
    return "#" + "".join(f"{min(value, 255):02x}" for value in values)


def parsed_colour(value: Any) -> Any:
    """Return a colour as three numbers; refuse other forms, with the one that is meant."""
    if isinstance(value, str):
        return linear_of(value)
    if _is_hex_number(value):
        raise bad_value(f"a colour of sRGB is text. Write '{_hex_of(value)}', in quotes.")
    if is_number(value):
        raise bad_value(f"{value} is one number; a colour has three. Write {[value] * 3}.")
    if isinstance(value, dict) and [str(name).lower() for name in value][:3] == ["r", "g", "b"]:
        raise bad_value(f"a colour is a list. Write {in_yaml(list(value.values())[:3])}.")
    if isinstance(value, list) and all(is_number(part) for part in value):
        return _checked_parts(value)
    return value


def _checked_parts(value: list[Any]) -> list[Any]:
    if len(value) == 4:
        raise bad_value(f"{value} has 4 numbers; colours have no alpha. Write {value[:3]}.")
    is_8_bit = (
        all(isinstance(part, int) and 0 <= part <= 255 for part in value) and max(value, default=0) > 16
    )
    if len(value) == 3 and is_8_bit:
        raise bad_value(f"{value} goes up to 255; colours go from 0 to 1, linear. Write '{_hex(value)}'.")
    return value


def no_bare_colour(entry: str, beginning: str) -> BeforeValidator:
    """Return a validator that refuses a colour where the name or the mapping of an entry must stand.

    `beginning` is the item of the mapping before the colour: `material: clay`.
    """

    def check(value: Any) -> Any:
        if (colour := _bare_colour(value)) is not None:
            raise finding(
                f"{entry} is a colour; it must be a name or a mapping. "
                f"Write {entry}: {{{beginning}, colour: {colour}}}."
            )
        return value

    return BeforeValidator(check)


def _bare_colour(value: Any) -> str | None:
    """Return a colour as a shot file writes it; None for a value that is meant as something else."""
    if isinstance(value, dict):
        names = [str(name).lower() for name in value]
        return (
            _bare_colour(list(value.values())) if names in (["r", "g", "b"], ["r", "g", "b", "a"]) else None
        )
    if isinstance(value, list):
        if len(value) not in (3, 4) or not all(is_number(part) for part in value):
            return None
        if all(0 <= part <= 1 for part in value):
            return in_yaml(value[:3])
        return f"'{_hex([round(part) for part in value[:3]])}'" if min(value) >= 0 else None
    if _is_hex_number(value):
        return f"'{_hex_of(value)}'"
    if not isinstance(value, str):
        return None
    if rgb := _RGB.match(value):
        return f"'{_hex([int(part) for part in rgb.groups()])}'"
    digits = value.removeprefix("#")
    if not re.fullmatch(r"#([0-9a-fA-F]{3,4}){1,2}|(?=.*\d)[0-9a-fA-F]{6}", value):
        return WORDS.get(value.lower())
    return f"'#{digits[:3] if len(digits) < 5 else digits[:6]}'"


def _is_hex_number(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 255 < value < 2**24


def _hex_of(value: int) -> str:
    """Return the colour that a whole number means: its six digits, or 0xc04020 as YAML has read it."""
    return f"#{value}" if len(str(value)) == 6 else f"#{value:06x}"


ColourParts = Annotated[list[ZeroToOne], Field(min_length=3, max_length=3)]

Colour = Annotated[
    ColourParts,
    BeforeValidator(parsed_colour),
    SchemaKeywords(type=["array", "string"], pattern=HEX_PATTERN),
]
"""Three numbers, linear Rec.709, or a text of sRGB; validated it is three numbers."""
