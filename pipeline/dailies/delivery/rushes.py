"""The finished frames of a shot as a display shows them, and cards for those that failed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.production.planning.history import History
from pipeline.production.request.frame_keys import PictureKeys
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store import paths, readers
from pipeline.production.store.store import Store
from pipeline.production.versions.provenance import Provenance, records
from render.graphics.slate import failure_card
from render.movie.planes import Frame
from render.post.colour import quantise, to_display

Shown = tuple[Frame, Mapping[str, str | int]]
"""A display frame, and what can be burnt in over it."""

Failed = Mapping[tuple[str, int], str]
"""Why frames failed in the last run, by what it told of them and their numbers."""

STAGES = ("simulate", "smooth_normals", "frame_camera", "render", "finish")

IN_WORK = "in work"
"""The version of what is not published."""


@dataclass(frozen=True)
class Look:
    """How frames are asked for: the values of which display, and with coverage or without."""

    display: str
    covered: bool


class Rushes:
    """The finished frames of a take, those that are there."""

    def __init__(self, request: RenderRequest, store: Store, failed: Failed) -> None:
        self.request, self._store = request, store
        self.keys: PictureKeys | None = request.picture_keys(store)
        self.version = _version(request, store, self.keys)
        history = History.of(store.root).failed(request.folders.name, STAGES, request.quality_name)
        self._reasons = {
            **history,
            **{n: why for (shot, n), why in failed.items() if shot == request.subject},
        }

    def holds(self, number: int) -> bool:
        return self.keys is not None and self._store.holds("frame", self.keys[number].frame)

    def covers(self, number: int) -> bool:
        """Whether how much of each pixel the subject covers is there too."""
        return self.keys is not None and self._store.holds("raw", self.keys[number].raw)

    def content(self, numbers: Sequence[int]) -> list[Any]:
        """Plain data of what is shown, cards and all."""
        shown = [self._key(n) if self.holds(n) else [n, self.reason(n)] for n in numbers]
        request = self.request
        return [
            request.name,
            request.quality_name,
            self.version,
            list(numbers),
            shown,
            dict(request.shown_as),
        ]

    def reason(self, number: int) -> str:
        """Why a frame is not there; often another one failed that it rests on."""
        if number in self._reasons:
            return self._reasons[number].removeprefix(f"frame {number}: ")
        first = min(self._reasons, default=None)
        return (
            "it was not made" if first is None else f"not made, as frame {first} failed: {self.reason(first)}"
        )

    def shown(self, number: int, look: Look) -> Shown:
        """A frame as a display shows it, or the card in its place.

        Raises FrameError where it is there and cannot be read, and forgets it, so that the next run makes it
        anew.
        """
        if not self.holds(number):
            return self._card(number, self.reason(number), look), self._values(number, "")
        return self._picture(number, look), self._values(number, self._key(number))

    def _picture(self, number: int, look: Look) -> Frame:
        request, picture = self.request, self.request.shot.picture
        light = self._layer("frame", number, self._key(number), "beauty")
        values = to_display(light, picture.lights.exposure, look.display, picture.view)
        frame: Frame = quantise(values, bits=16)
        if not look.covered:
            return frame
        assert self.keys is not None, "a frame that is there has a key"
        cover = self._layer("raw", number, self.keys[number].raw, "matte").reshape(*frame.shape[:2], 1)
        assert frame.shape[:2][::-1] == request.quality.rendered_size
        return np.concatenate([frame, np.rint(cover.clip(0.0, 1.0) * 65535).astype(np.uint16)], axis=2)

    def _layer(self, kind: str, number: int, key: str, layer: str) -> NDArray[np.float32]:
        read = readers.picture(key, self.request.quality.rendered_size)
        return self._store.read(kind, key, self.request.place(kind, number), read)[0][layer]

    def _card(self, number: int, reason: str, look: Look) -> Frame:
        size = self.request.quality.rendered_size
        heading = f"{self.request.name}  frame {number} failed"
        return opaque(quantise(failure_card(size, heading, reason), bits=16), look)

    def _key(self, number: int) -> str:
        return self.keys[number].frame if self.keys is not None else ""

    def _values(self, number: int, key: str) -> Mapping[str, str | int]:
        name, quality = self.request.name, self.request.quality_name
        return {"shot": name, "version": self.version, "frame": number, "key": key[:10], "quality": quality}


def opaque(frame: NDArray[Any], look: Look) -> Frame:
    """A frame (H, W, 3) as it is asked for: covered everywhere, where coverage is."""
    full = np.full((*frame.shape[:2], 1), np.iinfo(frame.dtype).max, dtype=frame.dtype)
    made: Frame = np.concatenate([frame, full], axis=2) if look.covered else frame
    return made


def _version(request: RenderRequest, store: Store, keys: PictureKeys | None) -> str:
    """The published version whose frames these are."""
    if keys is None or request.turntable is not None:
        return IN_WORK
    ours = {n: keys[n].frame for n in request.requested}
    for _, record in reversed(list(records(store.root / paths.published(request.name)))):
        if (
            isinstance(record, Provenance)
            and ours.items() <= {n: frame.frame for n, frame in record.frames.items()}.items()
        ):
            return record.version
    return IN_WORK
