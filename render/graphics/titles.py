"""Title cards: a title and a subtitle on a warm dark ground, fading in and out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from render.base.errors import BadInputError
from render.base.serialise import Triple
from render.graphics.typesetting import line


@dataclass(frozen=True)
class TitleCard:
    """A title card; sizes are shares of the picture's height.

    title, subtitle   one line each; the title is set in wide capitals
    ground, centre    display colours of the corners and of the glow behind the words
    ink, quiet        display colours of the title and of the subtitle
    """

    title: str
    subtitle: str = ""
    title_size: float = 0.085
    subtitle_size: float = 0.042
    ground: Triple = (0.075, 0.068, 0.064)
    centre: Triple = (0.205, 0.186, 0.172)
    ink: Triple = (0.93, 0.90, 0.85)
    quiet: Triple = (0.66, 0.61, 0.55)


def title_frames(
    card: TitleCard, size: tuple[int, int], count: int, fade: int
) -> Iterator[NDArray[np.float32]]:
    """Yield `count` frames of display values (H, W, 3); the words fade in over `fade` frames and out again.

    The ground does not fade, so a cut to the card does not flash black; its glow grows a little meanwhile.
    Raises BadInputError where the fades do not fit into `count`.
    """
    if fade < 0 or count < 1 or 2 * fade > count:
        raise BadInputError(f"a title of {count} frames cannot fade over {fade} at each end; at most half")
    title, subtitle = _words(card, size)
    for number in range(count):
        time = number / max(1, count - 1)
        picture = _ground(card, size, swell=_smooth(time))
        strength = _fade(number, count, fade)
        # The subtitle follows the title and leaves with it.
        late = _fade(number - fade // 2, count - fade // 2, fade)
        for ink, mask, amount in ((card.ink, title, strength), (card.quiet, subtitle, late)):
            cover = (mask * amount)[..., None]
            picture = picture * (1.0 - cover) + np.array(ink, dtype=np.float32) * cover
        yield np.asarray(picture, dtype=np.float32)


def _ground(card: TitleCard, size: tuple[int, int], swell: float) -> NDArray[np.float32]:
    width, height = size
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    across = (x - width / 2.0) / (0.80 * width)
    down = (y - 0.46 * height) / (0.95 * height)
    glow = np.exp(-(across**2 + down**2) / (0.10 + 0.03 * swell))[..., None]
    ground, centre = np.array(card.ground), np.array(card.centre)
    return np.asarray(ground + (centre - ground) * glow, dtype=np.float32)


def _words(card: TitleCard, size: tuple[int, int]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the coverage (H, W) of the title, a little above the middle, and of the subtitle below it."""
    width, height = size
    title = _fitted(card.title.upper(), "DroidSans", card.title_size * height, 0.30, width)
    subtitle = _fitted(card.subtitle, "DroidSerif-Italic", card.subtitle_size * height, 0.03, width)
    return _centred(title, size, 0.46), _centred(subtitle, size, 0.575)


def _fitted(text: str, font: str, height: float, spacing: float, width: int) -> NDArray[np.float32]:
    """Set a line at that height in pixels, or smaller where it would fill over four fifths of the width."""
    if not text.strip():
        return np.zeros((1, 1), dtype=np.float32)
    cover = line(text, font, max(2, round(height)), spacing)
    if cover.shape[1] > 0.8 * width:
        cover = line(text, font, max(2, int(height * 0.8 * width / cover.shape[1])), spacing)
    return cover[:, :width]


def _centred(cover: NDArray[np.float32], size: tuple[int, int], middle: float) -> NDArray[np.float32]:
    """Place a line on an empty page: centred across, the middle of its ink at a share of the height."""
    width, height = size
    page = np.zeros((height, width), dtype=np.float32)
    rows = np.flatnonzero(cover.any(axis=1))
    if not len(rows):
        return page
    ink = cover[rows[0] : rows[-1] + 1][:height]
    top = min(max(0, round(middle * height - ink.shape[0] / 2.0)), height - ink.shape[0])
    left = (width - ink.shape[1]) // 2
    page[top : top + ink.shape[0], left : left + ink.shape[1]] = ink
    return page


def _fade(number: int, count: int, fade: int) -> float:
    """Rise from 0 to 1 over the first `fade` frames and fall over the last."""
    if fade == 0:
        return 1.0
    return _smooth(min((number + 0.5) / fade, (count - number - 0.5) / fade, 1.0))


def _smooth(t: float) -> float:
    t = min(max(t, 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)
