"""Read the finished frames of a shot as display values, with cards for those that failed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.production.request.keys import PictureKeys
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store import paths, readers
from pipeline.production.store.event_log import History
from pipeline.production.store.store import Store
from pipeline.production.versions.provenance import Provenance, records
from render.graphics.slate import failure_card
from render.movie.planes import Frame
from render.post.colour import quantise, to_display

LabelledFrame = tuple[Frame, Mapping[str, str | int]]
"""A display frame, and the values that can be burnt in."""

Failures = Mapping[tuple[str, int], str]
"""Messages of the last run by name of a shot and frame number."""

STAGES = ("simulate", "smooth_normals", "frame_camera", "render", "finish")

IN_WORK = "in work"
"""The version of frames that are not published."""


@dataclass(frozen=True)
class FrameFormat:
    """The display that frames are converted for, and whether they have coverage as fourth channel."""

    display: str
    has_coverage: bool


class FrameReader:
    """Reader of the finished frames of a request."""

    def __init__(self, request: RenderRequest, store: Store, failures: Failures) -> None:
        self.request, self._store = request, store
        self.keys: PictureKeys | None = request.picture_keys(store)
        self.version = _version(request, store, self.keys)
        history = History.of(store.root).failed(request.folders.name, STAGES, request.quality_name)
        latest = {n: message for (shot, n), message in failures.items() if shot == request.subject}
        self._reasons = {**history, **latest}

    def is_finished(self, number: int) -> bool:
        """True if the finished frame is in the store."""
        return self.keys is not None and self._store.holds("frame", self.keys[number].frame)

    def has_coverage(self, number: int) -> bool:
        """True if the rendered frame, which has the subject's coverage, is in the store."""
        return self.keys is not None and self._store.holds("raw", self.keys[number].raw)

    def content(self, numbers: Sequence[int]) -> list[Any]:
        """Return plain data of everything that frames and cards show."""
        shown = [self._key(n) if self.is_finished(n) else [n, self.reason(n)] for n in numbers]
        request = self.request
        facts = [request.name, request.quality_name, self.version]
        return [*facts, list(numbers), shown, dict(request.shown_as)]

    def reason(self, number: int) -> str:
        """Return why a frame is missing: its own failure, or that of a frame before it."""
        if number in self._reasons:
            return self._reasons[number].removeprefix(f"frame {number}: ")
        first = min(self._reasons, default=None)
        return (
            "it was not made" if first is None else f"not made, as frame {first} failed: {self.reason(first)}"
        )

    def read(self, number: int, wanted: FrameFormat) -> LabelledFrame:
        """Read a frame, or draw the card that stands for it.

        A damaged frame raises FrameError and leaves the store, so that the next run makes it again.
        """
        if not self.is_finished(number):
            return self._card(number, self.reason(number), wanted), self._labels(number, "")
        return self._picture(number, wanted), self._labels(number, self._key(number))

    def _picture(self, number: int, wanted: FrameFormat) -> Frame:
        request, picture = self.request, self.request.shot.picture
        light = self._layer("frame", number, self._key(number), "beauty")
        values = to_display(light, picture.lights.exposure, wanted.display, picture.view)
        frame: Frame = quantise(values, bits=16)
        if not wanted.has_coverage:
            return frame
        assert self.keys is not None, "a finished frame has a key"
        cover = self._layer("raw", number, self.keys[number].raw, "matte").reshape(*frame.shape[:2], 1)
        assert frame.shape[:2][::-1] == request.quality.rendered_size
        return np.concatenate([frame, np.rint(cover.clip(0.0, 1.0) * 65535).astype(np.uint16)], axis=2)

    def _layer(self, kind: str, number: int, key: str, layer: str) -> NDArray[np.float32]:
        read = readers.picture(key, self.request.quality.rendered_size)
        return self._store.read(kind, key, self.request.place(kind, number), read)[0][layer]

    def _card(self, number: int, reason: str, wanted: FrameFormat) -> Frame:
        size = self.request.quality.rendered_size
        heading = f"{self.request.name}  frame {number} failed"
        return opaque(quantise(failure_card(size, heading, reason), bits=16), wanted)

    def _key(self, number: int) -> str:
        return self.keys[number].frame if self.keys is not None else ""

    def _labels(self, number: int, key: str) -> Mapping[str, str | int]:
        name, quality = self.request.name, self.request.quality_name
        return {"shot": name, "version": self.version, "frame": number, "key": key[:10], "quality": quality}


def opaque(frame: NDArray[Any], wanted: FrameFormat) -> Frame:
    """Return a frame (H, W, 3) in a format: with full coverage if it has coverage."""
    if not wanted.has_coverage:
        return frame
    full = np.full((*frame.shape[:2], 1), np.iinfo(frame.dtype).max, dtype=frame.dtype)
    return np.concatenate([frame, full], axis=2)


def _version(request: RenderRequest, store: Store, keys: PictureKeys | None) -> str:
    """Return the published version that has exactly these frames, or IN_WORK."""
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
