"""The keys of pictures and of what is made of them: each is the digest of all that its file is made from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pipeline.production.keys.digest import Key, key_of
from pipeline.production.keys.stages import ASSEMBLE, FILM, FINISH, FRAME_CAMERA, RENDER, STAGES


def cameras_key(meshes: Sequence[Key], views: Sequence[Any], *settings: Any) -> Key:
    """Return the key of all cameras of a shot.

    views     for each picture its number, its mesh frame, the turn of the object and the view
    settings  aspect, how far the camera follows, pieces of a net, move of the camera for the stage
    """
    return key_of(FRAME_CAMERA.recipe, meshes, views, *settings)


def raw_key(normals: Key, turn: Any, framing: Any, appearance: Key, seed: int, *more: Any) -> Key:
    """Return the key of a rendered picture.

    normals     key of the surface that it shows
    turn        radians by which the object and the lights are turned
    framing     its camera and the place of the stage
    appearance  digest of what all pictures of the request share
    more        what layers, the shutter and measured colours depend on
    """
    return key_of(RENDER.recipe, normals, turn, framing, appearance, seed, *more)


def frame_key(raw: Key, denoise: str, neighbours: Sequence[Key]) -> Key:
    """Return the key of a denoised frame; `neighbours` are the raw keys of the frames it is averaged with."""
    return key_of(FINISH.recipe, raw, denoise, neighbours)


def still_key(form: str, frame: Key, shown_as: Any) -> Key:
    """Return the key of a still: `form` names its stage, `shown_as` how light becomes a display's picture."""
    return key_of(STAGES[form].recipe, frame, shown_as)


def movie_key(frames: Sequence[Key], rate: str, shown_as: Any, bits: int) -> Key:
    """Return the key of the movie of one shot."""
    return key_of(ASSEMBLE.recipe, frames, rate, shown_as, bits)


def film_key(
    items: Sequence[Any], rate: str, audio: Any, frames: Sequence[Key], shown_as: Sequence[Any], bits: int
) -> Key:
    """Return the key of a film; `items` and `audio` are plain data."""
    return key_of(FILM.recipe, items, rate, audio, frames, shown_as, bits)
