"""What a title card says and how it looks; drawn by `cards.py` next to it, which planning does without."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from flowsculpt.render.base.serialise import OMIT_DEFAULT, Triple

MIDDLES = {"low": 0.84, "middle": 0.48, "high": 0.15}
"""Where the middle of the words is, as a share of the picture's height from its upper edge, by position."""

SIDES = {"left": 0.0, "right": 0.5}
"""Where the half of a wide picture begins that has the words, as a share of its width, by position."""

POSITIONS = (*MIDDLES, *SIDES)


@dataclass(frozen=True)
class CardStyle:
    """How cards look.

    font, subtitle_font  names of fonts that OpenImageIO ships or the system has
    colour    display values of the words; by default a warm white, and a darker one for subtitles
    size      of the words, as a factor
    ground    display values behind the words; by default a dark grey with a glow
    over      whether the words lie over the pictures, in place of a ground
    position  one of POSITIONS; by default low over pictures, else middle
    """

    font: str = field(default="DroidSans", metadata=OMIT_DEFAULT)
    subtitle_font: str = field(default="DroidSerif-Italic", metadata=OMIT_DEFAULT)
    colour: Triple | None = field(default=None, metadata=OMIT_DEFAULT)
    size: float = field(default=1.0, metadata=OMIT_DEFAULT)
    ground: Triple | None = field(default=None, metadata=OMIT_DEFAULT)
    over: bool = field(default=False, metadata=OMIT_DEFAULT)
    position: str = field(default="", metadata=OMIT_DEFAULT)

    @property
    def middle(self) -> float:
        """The height of the middle of the words, as in MIDDLES."""
        return MIDDLES.get(self.position, MIDDLES["low" if self.over else "middle"])

    def with_values(self, **written: Any) -> CardStyle:
        """Return the style with other values; None leaves one as it is.

        Colours are linear Rec.709; a `ground` of "picture" lays the words over the pictures.
        """
        from flowsculpt.render.scene.rgb_spaces import srgb_of_linear  # numpy, which planning does without

        values = {name: value for name, value in written.items() if value is not None}
        if "ground" in values:
            values["over"] = values["ground"] == "picture"
            values["ground"] = None if values["over"] else values["ground"]
        for name in ("colour", "ground"):
            if values.get(name) is not None:
                values[name] = tuple(srgb_of_linear(values[name]).tolist())
        return replace(self, **values)


PLAIN = CardStyle()


@dataclass(frozen=True)
class TitleCard:
    """A title card: title in wide capitals and subtitle, a line each where the page is wide enough."""

    title: str
    subtitle: str = ""
    style: CardStyle = PLAIN
