"""Views, which turn linear light into display colours: an OpenColorIO config, a view and displays."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from flowsculpt.render.base.limited_process import Parser, ParserError
from flowsculpt.render.base.render_errors import BadInputError, suggest
from flowsculpt.render.scene.picture_file import DEFAULT_CONFIG
from flowsculpt.render.scene.rgb_spaces import REC709

BUILT_IN = "ocio://"

LINEAR_REC709 = (
    "lin_rec709_scene",
    "lin_rec709",
    "Linear Rec.709 (sRGB)",
    "Utility - Linear - sRGB",
    "lin_srgb",
)
"""Names of linear Rec.709, the space of pictures, in common configs."""

_MOST_SAID = 300

_MOST_TRIED = 64  # views whose tables are read before a config is used


@dataclass(frozen=True)
class ColourView:
    """A view and the displays of movies and stills.

    config  a built-in config of OpenColorIO, ocio://…, or the path of a file
    view    its name in the config
    movie   the display of movies
    still   the display of single pictures
    space   the config's name of linear Rec.709
    digest  of the config's files; empty for a built-in one

    working_space  the space of the light that is shown, by its name in `WORKING_SPACES`
    """

    config: str = DEFAULT_CONFIG
    view: str = "ACES 2.0 - SDR 100 nits (Rec.709)"
    movie: str = "Rec.1886 Rec.709 - Display"
    still: str = "sRGB - Display"
    space: str = "lin_rec709_scene"
    digest: str = ""
    working_space: str = REC709.name

    def for_previews(self) -> ColourView:
        """Return the same view of linear Rec.709, which quick previews compute in."""
        return replace(self, working_space=REC709.name)

    def in_hdr(self) -> ColourView:
        """Return ACES 2.0 for movies of high dynamic range, in PQ. Raises BadInputError for another view."""
        if (self.config, self.view, self.movie) != (ACES.config, ACES.view, ACES.movie):
            raise BadInputError(
                f"HDR movies show light by ACES 2.0, not by the shot's view {self.view!r} on {self.movie!r}; "
                "leave its view out, or deliver h265"
            )
        return replace(self, view="ACES 2.0 - HDR 1000 nits (P3 D65)", movie="Rec.2100-PQ - Display")

    def display(self, use: str) -> str:
        """Return the display for rec709 (movies) or srgb (pages). Raises BadInputError for others."""
        uses = {"rec709": self.movie, "srgb": self.still}
        if use not in uses:
            raise BadInputError(f"display is {use!r}; it can be {', '.join(uses)}")
        return uses[use]

    @property
    def recipe(self) -> dict[str, str]:
        """Everything that decides the colours; without the path of the config."""
        recipe = {**vars(self), "config": "" if self.digest else self.config}
        if self.working_space == REC709.name:
            del recipe["working_space"]  # recipes are parts of keys, and had none at first
        return recipe


ACES = ColourView()
"""ACES 2.0, from OpenColorIO's built-in config."""


def view_of(
    config: str, view: str | None, display: str | None, space: str | None, digest: str = ""
) -> ColourView:
    """Return a view of a config. What is None is the config's default or, for the built-in config, ACES's.

    Raises BadInputError where the config cannot be read, or has no such view, display or space.
    """
    opened = _read(config, digest)
    displays = list(opened.getDisplayNames())
    if display is not None:
        _require_known("display", display, displays, config)
        movie = still = display
    elif config == ACES.config:
        movie, still = ACES.movie, ACES.still
    else:
        movie = still = opened.getDefaultDisplayName()
    if view is None:
        view = opened.getDefaultViewName(movie)
    for shown_on in dict.fromkeys((movie, still)):
        _require_known("view", view, list(opened.getViewNames(shown_on)), f"{config} on {shown_on}")
    names = list(opened.getColorSpaceNames())
    spaces = [alias for name in names for alias in (name, *opened.getAliases(name))]
    if space is None:
        space = next((name for name in LINEAR_REC709 if name in spaces), None)
        if space is None:
            raise BadInputError(
                f"{config} does not say which of its spaces is linear Rec.709, the space of our pictures. "
                f"Name it as space; there are {', '.join(names[:12])}."
            )
    _require_known("space", space, spaces, config)
    return ColourView(config, view, movie, still, space, digest)


@cache
def _read(config: str, digest: str) -> Any:
    """Read a config, once for each content of its file, and first in a process of its own."""
    import OpenImageIO as oiio

    if digest:
        try:
            Parser("flowsculpt.render.post.view").answer_about_content(Path(config), digest, "OpenImageIO")
        except ParserError as error:
            raise BadInputError(
                f"{config}: it cannot be read as an OpenColorIO config ({error}); correct it, or name another"
            ) from None
    opened = oiio.ColorConfig(config)
    if not opened.getNumDisplays():
        raise BadInputError(
            f"{config} is not an OpenColorIO config with a display ({_reason(opened, config)}); "
            f"name a file, or a built-in config such as {DEFAULT_CONFIG}"
        )
    return opened


def _reason(opened: Any, config: str) -> str:
    """Return why OpenColorIO refuses a config, such as its version, without its path, said three times."""
    try:
        said = str(opened.geterror()).rpartition("' failed. ")[2].replace(f"'{config}'", "")
    except UnicodeDecodeError:  # it quotes the file
        return "its text is not UTF-8"
    return " ".join(said.split())[:_MOST_SAID]


def _require_known(kind: str, name: str, names: list[str], config: str) -> None:
    if name not in names:
        raise BadInputError(f"{config} has no {kind} {name!r}. {suggest(name, names, cutoff=0.4)}")


def _try_views(config: str) -> bytes:
    """Read a config, and the tables of its views."""
    import OpenImageIO as oiio

    opened, pixel = oiio.ColorConfig(config), oiio.ImageBuf(oiio.ImageSpec(1, 1, 3, oiio.FLOAT))
    pairs = [(d, view) for d in opened.getDisplayNames() for view in opened.getViewNames(d)]
    for display, view in pairs[:_MOST_TRIED]:
        oiio.ImageBufAlgo.ociodisplay(pixel, display, view, colorconfig=config)
    return b""


if __name__ == "__main__":
    Parser.serve(_try_views)
