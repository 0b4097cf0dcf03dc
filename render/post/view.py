"""How linear light becomes what a display shows: an OpenColorIO config, a view in it, and displays."""

from __future__ import annotations

from dataclasses import dataclass, field
from difflib import get_close_matches
from functools import cache
from typing import Any

from render.base.errors import BadInputError
from render.scene.textures import DEFAULT_CONFIG

BUILT_IN = "ocio://"

LINEAR_REC709 = (
    "lin_rec709_scene",
    "lin_rec709",
    "Linear Rec.709 (sRGB)",
    "Utility - Linear - sRGB",
    "lin_srgb",
)
"""What configs call the space that pictures are in."""


@dataclass(frozen=True)
class ColourView:
    """A view, and the displays it is seen on.

    config  one that OpenColorIO has built in, ocio://…, or the path of a file
    view    its name in the config
    movie   the display that movies are made for
    still   the display that single pictures are made for
    space   what the config calls linear Rec.709
    digest  of the files that it was read from; nothing where it is built in
    """

    config: str = DEFAULT_CONFIG
    view: str = "ACES 2.0 - SDR 100 nits (Rec.709)"
    movie: str = "Rec.1886 Rec.709 - Display"
    still: str = "sRGB - Display"
    space: str = "lin_rec709_scene"
    digest: str = field(default="")

    def display(self, use: str) -> str:
        """That of a use: rec709 for movies, srgb for pictures on a page. Raises BadInputError for others."""
        uses = {"rec709": self.movie, "srgb": self.still}
        if use not in uses:
            raise BadInputError(f"display is {use!r}; it can be {', '.join(uses)}")
        return uses[use]

    @property
    def recipe(self) -> dict[str, str]:
        """What decides its colours, without where files lie."""
        config = "" if self.digest else self.config
        return {**vars(self), "config": config}


ACES = ColourView()
"""ACES 2.0, of the config that OpenColorIO has built in."""


def view_of(
    config: str, view: str | None, display: str | None, space: str | None, digest: str = ""
) -> ColourView:
    """A view of a config, what is not named being the config's default; of the built-in one, ours.

    Raises BadInputError where the config cannot be read, or has no such view, display or space.
    """
    found = _read(config, digest)
    displays = list(found.getDisplayNames())
    if display is not None:
        movie = still = _known("display", display, displays, config)
    elif config == ACES.config:
        movie, still = ACES.movie, ACES.still
    else:
        movie = still = found.getDefaultDisplayName()
    if view is None:
        view = found.getDefaultViewName(movie)
    for each in dict.fromkeys((movie, still)):
        _known("view", view, list(found.getViewNames(each)), f"{config} on {each}")
    spaces = {alias: name for name in found.getColorSpaceNames() for alias in (name, *found.getAliases(name))}
    if space is None:
        space = next((name for name in LINEAR_REC709 if name in spaces), None)
        if space is None:
            raise BadInputError(
                f"{config} does not say which of its spaces is linear Rec.709, which pictures are in. "
                f"Name it as space; there are {', '.join(list(dict.fromkeys(spaces.values()))[:12])}."
            )
    _known("space", space, list(spaces), config)
    return ColourView(config, view, movie, still, space, digest)


@cache
def _read(config: str, digest: str) -> Any:
    """The config, read once for each content of its file."""
    import OpenImageIO as oiio

    found = oiio.ColorConfig(config)
    if not found.getNumDisplays():
        reason = str(found.geterror()).strip().splitlines()
        told = f" ({reason[-1].strip()})" if reason else ""
        raise BadInputError(
            f"{config} is no OpenColorIO config with a display{told}. Name a file, or one that is built in, "
            f"such as {DEFAULT_CONFIG}."
        )
    return found


def _known(what: str, name: str, names: list[str], config: str) -> str:
    if name not in names:
        close = get_close_matches(name, names, 1, cutoff=0.4)
        hint = f"Did you mean {close[0]!r}?" if close else f"There are: {', '.join(names)}."
        raise BadInputError(f"{config} has no {what} {name!r}. {hint}")
    return name
