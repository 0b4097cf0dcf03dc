"""Sequences of pictures of a shot, for pages and plug-ins that show them: rendered, relit, published."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flowsculpt.pipeline.frames import FrameRange
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.planning.frame_states import PICTURE_STAGES, FrameStates
from flowsculpt.pipeline.production.planning.plan import Runs
from flowsculpt.pipeline.production.request.keys import PictureKeys, projection_of
from flowsculpt.pipeline.production.request.lookup import require_quality
from flowsculpt.pipeline.production.request.render_request import RenderRequest
from flowsculpt.pipeline.production.request.shot_source import ShotSource
from flowsculpt.pipeline.production.stages import STAGES
from flowsculpt.pipeline.production.store import readers
from flowsculpt.pipeline.production.store.store import Key, Store, key_of
from flowsculpt.render.base.render_errors import RenderError
from flowsculpt.render.graphics.contact_sheet import reduced
from flowsculpt.render.post.image import read_header
from flowsculpt.render.post.picture_display import PictureDisplay
from flowsculpt.render.scene.render_camera import Projection
from flowsculpt.render.scene.rgb_spaces import LUMA

STALE = "the shot has changed since it was rendered; flowsculpt why says how"


@dataclass(frozen=True)
class PictureFile:
    """A readable picture: its file, its key, and its header."""

    path: Path
    key: Key
    header: Mapping[str, Any]

    @property
    def projection(self) -> Projection:
        """The projection of its camera."""
        return projection_of(self.header)


@dataclass(frozen=True)
class PictureSequence:
    """A sequence of pictures of one shot, by frame.

    kind      render, relit, version or wedge
    label     distinguishes it from other sequences of the shot
    subject   its name in event logs
    numbers   all frames of the sequence
    files     frames that are rendered
    faults    frames that failed or are stale: the state and the reason
    seconds   seconds of rendering by frame and part, where they are known
    display   how they are shown: by default as those of shots that say nothing of it
    note      the note of a published version
    raws      rendered frames, whose AOVs the finished ones do not have, where they are there
    source    the shot file that it is rendered from, and what it rests on
    """

    shot: str
    kind: str
    label: str
    quality: str
    subject: str
    numbers: tuple[int, ...]
    files: Mapping[int, Path]
    faults: Mapping[int, tuple[str, str]]
    seconds: Mapping[int, Mapping[str, float]]
    display: PictureDisplay = field(default_factory=PictureDisplay)
    note: str = ""
    raws: Mapping[int, Path] = field(default_factory=dict)
    source: ShotSource | None = None

    @cached_property
    def pictures(self) -> Mapping[int, PictureFile]:
        """The pictures that can be read, by frame."""
        pictures = {}
        for number, path in self.files.items():
            with suppress(RenderError, KeyError):
                header = read_header(path)
                pictures[number] = PictureFile(path, str(header["key"]), header)
        return pictures

    def states(self) -> dict[int, tuple[str, str]]:
        """Return by frame the state and the reason of frames that are missing, failed or stale."""
        states: dict[int, tuple[str, str]] = {}
        for number in self.numbers:
            state, why = self.faults.get(number, ("", ""))
            if number in self.pictures:
                if state == "stale":
                    states[number] = state, why
            elif number in self.files:
                states[number] = "failed", "it cannot be read; flowsculpt verify repairs it"
            else:
                states[number] = ("failed", why) if state == "failed" else ("missing", "it is not rendered")
        return states

    def still_key(self, form: str, number: int) -> Key:
        """The key of a still, the same as `RenderRequest.still_key`, so that both share their files."""
        return key_of(STAGES[form].recipe, self.pictures[number].key, self.display.data)


@dataclass(frozen=True)
class SequenceGrid:
    """Sequences of the cells of a grid, such as a wedge: what differs between them, and the grid's columns.

    captions  names and values of each cell
    """

    name: str
    columns: int | None
    captions: tuple[tuple[tuple[str, str], ...], ...]
    sequences: tuple[PictureSequence, ...]


@dataclass(frozen=True)
class SequenceQuery:
    """A shot whose sequences are wanted, at these qualities; at all qualities if there are none.

    Raises UsageError for what is not a quality.
    """

    project: Project
    path: Path
    qualities: tuple[str, ...]

    def __post_init__(self) -> None:
        for quality in self.qualities:
            require_quality(quality)

    def includes(self, quality: str) -> bool:
        return not self.qualities or quality in self.qualities

    def requests(self) -> Iterator[RenderRequest]:
        """Yield the request of each quality that was begun, with the layers of its finished frames."""
        return (
            each for each in self.project.rendered_requests(self.path) if self.includes(each.quality_name)
        )

    def rendered(self, request: RenderRequest, kind: str, label: str) -> PictureSequence:
        """Return the frames of a request that are rendered, and the faults of the others."""
        root = self.project.root
        failed = self.project.history.failed(request.folders.title, PICTURE_STAGES, request.quality_name)
        stale = FrameStates.of_pictures(request, self.project.store, self.project.history).stale
        faults = {number: ("failed", message) for number, message in failed.items()}
        faults |= dict.fromkeys(stale, ("stale", STALE))
        places = {n: root / request.place("frame", n) for n in request.angles}
        return PictureSequence(
            shot=request.name,
            kind=kind,
            label=label,
            quality=request.quality_name,
            subject=request.folders.title,
            numbers=tuple(sorted(request.requested)),
            files={number: path for number, path in places.items() if path.is_file()},
            display=request.shot.picture.display,
            faults=faults,
            seconds=Runs(root).render_seconds(request),
            raws={n: root / request.place("raw", n) for n in request.angles},
            source=request.source,
        )


DULL, NEARLY_BLACK = 180, 40
"""99th percentiles of luminance, of 255, below which a picture lacks a highlight, and is nearly black."""


@dataclass(frozen=True, eq=False)
class FinishedPictures:
    """The finished frames of a request as displays show them, with the view and the exposure of the shot."""

    request: RenderRequest
    store: Store

    @cached_property
    def _keys(self) -> PictureKeys | None:
        return self.request.keys.pictures(self.store)

    def key(self, number: int) -> Key | None:
        """Return the key of a frame; None where it is not there."""
        key = None if self._keys is None else self._keys[number].frame
        return key if self.store.holds("frame", key) else None

    def pixels(
        self, number: int, factor: int = 1, bits: int = 8, display: str = "srgb"
    ) -> NDArray[Any] | None:
        """Return a frame, uint8 or for more `bits` uint16 (H, W, 3); None where it is not there.

        factor  a whole number by which it is smaller

        Raises FrameError where it is damaged.
        """
        if (key := self.key(number)) is None:
            return None
        reader = readers.picture(key, self.request.pictures.quality.rendered_size)
        light = self.store.read("frame", key, self.request.place("frame", number), reader)[0]["beauty"]
        return self.request.shot.picture.display.pixels(reduced(light, factor), display, bits)

    @staticmethod
    def light_notes(pictures: Mapping[int, NDArray[Any] | None]) -> list[str]:
        """Return lines about frames without highlights; None stands for frames that are not there.

        pictures  uint8 (H, W, 3) by frame number
        """
        whites = {n: white_level(picture) for n, picture in sorted(pictures.items()) if picture is not None}
        black = [number for number, white in whites.items() if white < NEARLY_BLACK]
        notes = []
        if black:
            frames = f"frames {FrameRange.of(black)} are" if len(black) > 1 else f"frame {black[0]} is"
            notes.append(
                f"{frames} nearly black: 99% of the pixels are below {NEARLY_BLACK} of 255. Add light."
            )
        if whites and NEARLY_BLACK <= (brightest := max(whites.values())) < DULL:
            notes.append(
                f"no highlight: in the brightest frame 99% of the pixels are below {brightest} of 255; "
                "lively pictures reach 215 to 250. Write lights: {exposure: 0.5}, or a smaller and stronger "
                "key light."
            )
        return notes


def white_level(picture: NDArray[Any]) -> int:
    """Return the 99th percentile of luminance of a picture (H, W, 3) in 8 bits."""
    return int(np.percentile(picture @ LUMA, 99.0))
